"""Words of CiA 402 (IEC 61800-7-201): controlword, statusword, states, modes, faults.

Plain data that the drive, its dictionary and its masters share; ``_words.h`` is the same in C. The
transitions between the states are in ``sjerk.cia402``. Never here: decisions.
"""

from __future__ import annotations

import enum

from sjerk._binding import lib


class ControlWord(enum.IntFlag):
    """Bits of the controlword 6040h.

    >>> ControlWord.ENABLE_OPERATION | 0x07
    <ControlWord.SWITCH_ON|ENABLE_VOLTAGE|QUICK_STOP|ENABLE_OPERATION: 15>
    """

    SWITCH_ON = 0x0001
    """Bit 0 switches the drive on."""
    ENABLE_VOLTAGE = 0x0002
    """Bit 1 enables the voltage; 0 disables it at once."""
    QUICK_STOP = 0x0004
    """Bit 2 stops the drive when it is 0."""
    ENABLE_OPERATION = 0x0008
    """Bit 3 enables the operation."""
    MODE_4 = 0x0010
    """Bit 4 belongs to the mode: new set-point, start of homing, enable interpolation."""
    MODE_5 = 0x0020
    """Bit 5 belongs to the mode: change the set immediately."""
    MODE_6 = 0x0040
    """Bit 6 belongs to the mode: the target is relative."""
    FAULT_RESET = 0x0080
    """Bit 7 resets a fault by its rising edge."""
    HALT = 0x0100
    """Bit 8 halts the axis by 605Dh."""
    MODE_9 = 0x0200
    """Bit 9 belongs to the mode: change on set-point."""


class StatusWord(enum.IntFlag):
    """Bits of the statusword 6041h.

    Bits 10, 12 and 13 belong to the mode; the names here are those of CSP.

    >>> bool(StatusWord(0x1237) & StatusWord.FOLLOWS)
    True
    """

    READY_TO_SWITCH_ON = 0x0001
    """Bit 0 of the state."""
    SWITCHED_ON = 0x0002
    """Bit 1 of the state."""
    OPERATION_ENABLED = 0x0004
    """Bit 2 of the state."""
    FAULT = 0x0008
    """Bit 3 of the state."""
    VOLTAGE_ENABLED = 0x0010
    """Bit 4 shows that the power is there."""
    QUICK_STOP = 0x0020
    """Bit 5 of the state is 0 during a quick stop."""
    SWITCH_ON_DISABLED = 0x0040
    """Bit 6 of the state."""
    WARNING = 0x0080
    """Bit 7 shows a warning."""
    SYNC = 0x0100
    """Bit 8 is the maker's: this period had its SYNC."""
    REMOTE = 0x0200
    """Bit 9 shows that the controlword is obeyed."""
    TARGET_REACHED = 0x0400
    """Bit 10 shows that the target is reached, or that the axis stands after a halt."""
    INTERNAL_LIMIT = 0x0800
    """Bit 11 shows that a limit of the drive is active."""
    FOLLOWS = 0x1000
    """Bit 12 shows in CSP, CSV and CST that the drive follows its target."""
    FOLLOWING_ERROR = 0x2000
    """Bit 13 shows that the following error is larger than 6065h for 6066h."""


class DriveState(enum.Enum):
    """States of the drive; the value is (number in C, mask, pattern).

    Mask and pattern are those of the statusword.
    """

    NOT_READY_TO_SWITCH_ON = (0, 0x4F, 0x00)
    """The drive initialises itself."""
    SWITCH_ON_DISABLED = (1, 0x4F, 0x40)
    """The drive is initialised, the power may not be switched on."""
    READY_TO_SWITCH_ON = (2, 0x6F, 0x21)
    """The power may be switched on."""
    SWITCHED_ON = (3, 0x6F, 0x23)
    """The power is on, the motor is not driven."""
    OPERATION_ENABLED = (4, 0x6F, 0x27)
    """The motor is driven by the mode."""
    QUICK_STOP_ACTIVE = (5, 0x6F, 0x07)
    """The axis stops by 605Ah, or stands after that."""
    FAULT_REACTION_ACTIVE = (6, 0x4F, 0x0F)
    """A fault has occurred, the axis stops by 605Eh."""
    FAULT = (7, 0x4F, 0x08)
    """The motor is not driven until the fault is reset."""

    @property
    def number(self) -> int:
        """The state's number in C (``SJ_STATE_...``)."""
        return self.value[0]

    @classmethod
    def of(cls, statusword: int) -> DriveState:
        """The state that a statusword shows; raises ``ValueError`` where it shows none.

        >>> DriveState.of(0x1237)
        <DriveState.OPERATION_ENABLED: (4, 111, 39)>
        """
        for state in cls:
            _, mask, pattern = state.value
            if statusword & mask == pattern:
                return state
        raise ValueError(f"statusword = {statusword:#06x} shows no state of CiA 402")


class Mode(enum.IntEnum):
    """Modes of operation 6060h that the drive has."""

    NONE = 0
    """No mode: the drive brings the axis to rest and holds it."""
    PROFILE_POSITION = 1
    """The drive plans its own motion to 607Ah."""
    PROFILE_VELOCITY = 3
    """The drive plans its own motion to the velocity 60FFh."""
    PROFILE_TORQUE = 4
    """The torque goes to 6071h along the slope 6087h."""
    HOMING = 6
    """The drive looks for its reference by the method 6098h."""
    INTERPOLATED_POSITION = 7
    """60C1h:1 is the set-point of each period while bit 4 of the controlword is 1."""
    CSP = 8
    """Cyclic synchronous position: 607Ah is the set-point of each period."""
    CSV = 9
    """Cyclic synchronous velocity: 60FFh is the set-point of each period."""
    CST = 10
    """Cyclic synchronous torque: 6071h is the set-point of each period."""


class DriveFault(enum.IntEnum):
    """Faults by name. Those up to `RPDO_TIMEOUT` can be injected (`Drive.inject`)."""

    OVER_CURRENT = 1
    """The output current is too high."""
    EARTH = 2
    """The output has a connection to earth."""
    OVER_VOLTAGE = 3
    """The DC link has too high a voltage."""
    UNDER_VOLTAGE = 4
    """The DC link has too low a voltage."""
    OVER_TEMPERATURE = 5
    """The drive is too hot."""
    ENCODER = 6
    """The encoder has failed."""
    SAFE_TORQUE_OFF = 7
    """The safe torque off input is active."""
    BRAKE = 8
    """The brake has failed."""
    LOST_LINK = 9
    """The master is gone; 6007h says what the drive does."""
    RPDO_TIMEOUT = 10
    """A receive PDO did not come within its deadline (140xh:5); 6007h says what the drive does."""
    OVER_SPEED = 11
    """The motor turns faster than it may."""
    FOLLOWING_ERROR = 12
    """The following error was larger than 6065h for 6066h."""
    REFERENCE_LIMIT = 13
    """A target was further than the jump limit from the one before."""
    SYNC = 14
    """More SYNCs were missed than 10F1h:2 allows."""

    @property
    def code(self) -> int:
        """Error code 603Fh.

        >>> hex(DriveFault.FOLLOWING_ERROR.code)
        '0x8611'
        """
        return int(lib.sj_drive_fault_code(self.value))
