"""One control cycle, from top to bottom; it is C, the states of an axis are here to be read."""
