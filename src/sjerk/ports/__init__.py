"""Ports: one module per wire, each behind its own extra."""
