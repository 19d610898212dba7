"""Goals of an action server and goal streams, on a host."""
