"""sjerk: a motion kernel in Python and C."""
