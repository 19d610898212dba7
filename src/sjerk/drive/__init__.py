"""A simulated servo drive of CiA 402, and the drive as a device with objects."""

from sjerk.drive.config import MOTORS, DriveConfig, DriveConfigError, Jump, Motor
from sjerk.drive.device import Device
from sjerk.drive.drive import Drive, DriveFeedback, Finding, Report
from sjerk.drive.eds import eds
from sjerk.drive.entries import Abort, SdoError
from sjerk.drive.objects import OBJECTS, entry
from sjerk.drive.words import ControlWord, DriveFault, DriveState, Mode, StatusWord

__all__ = [
    "MOTORS",
    "OBJECTS",
    "Abort",
    "ControlWord",
    "Device",
    "Drive",
    "DriveConfig",
    "DriveConfigError",
    "DriveFault",
    "DriveFeedback",
    "DriveState",
    "Finding",
    "Jump",
    "Mode",
    "Motor",
    "Report",
    "SdoError",
    "StatusWord",
    "eds",
    "entry",
]
