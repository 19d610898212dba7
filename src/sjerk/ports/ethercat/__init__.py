"""EtherCAT: a kernel as the main device of drives, and simulated drives for other main devices."""

from sjerk.ports.ethercat.access import BusError
from sjerk.ports.ethercat.behaviours import BEHAVIOURS, Behaviour
from sjerk.ports.ethercat.line import Line
from sjerk.ports.ethercat.main_device import MainDevice
from sjerk.ports.ethercat.settings import BusSettings, DriveSettings

__all__ = [
    "BEHAVIOURS",
    "Behaviour",
    "BusError",
    "BusSettings",
    "DriveSettings",
    "Line",
    "MainDevice",
]
