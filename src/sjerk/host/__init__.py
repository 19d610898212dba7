"""What commands and reads a running kernel."""
