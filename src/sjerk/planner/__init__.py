"""Plans from any state to any target, for one axis and for many."""
