"""A CiA 402 servo drive as a device with objects."""
