"""EtherCAT: simulated drives as subdevices for other people's main devices, and their tests."""

from sjerk.ports.ethercat.behaviours import BEHAVIOURS, Behaviour
from sjerk.ports.ethercat.line import Line

__all__ = ["BEHAVIOURS", "Behaviour", "Line"]
