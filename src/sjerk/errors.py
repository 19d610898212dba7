"""Exceptions of sjerk. Each carries the data that a program needs to react."""

from __future__ import annotations


class SjerkError(Exception):
    """Base of every error that sjerk raises on purpose."""
