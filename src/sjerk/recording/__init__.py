"""Every cycle to a file, and again from there."""
