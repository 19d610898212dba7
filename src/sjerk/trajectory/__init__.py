"""Motion through many points."""
