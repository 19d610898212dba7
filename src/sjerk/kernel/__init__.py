"""A kernel: its axes, its process, its clock, its file of settings."""
