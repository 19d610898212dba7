"""CANopen: a simulated drive on a bus, and a kernel as its master."""
