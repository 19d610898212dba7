"""CiA 402 (IEC 61800-7-201) to be read: commands, the transition table, its conditions.

What each command and transition is, as data; ``next_state`` decides by it. Tests hold the table and
the C (``_cia402.c``) against an oracle that knows neither.

This module is the front of the drive: states, words, modes and faults come from
``sjerk.drive.words``, ``DriveConfig`` and the motors from ``sjerk.drive.config``, ``Drive`` from
``sjerk.drive.drive``. Never here: planning, time, transport.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple

from sjerk.drive import (
    MOTORS,
    ControlWord,
    Drive,
    DriveConfig,
    DriveConfigError,
    DriveFault,
    DriveFeedback,
    DriveState,
    Finding,
    Jump,
    Mode,
    Motor,
    Report,
    StatusWord,
)

__all__ = [
    "CONDITIONS",
    "MOTORS",
    "TRANSITIONS",
    "Command",
    "ControlWord",
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
    "Situation",
    "StatusWord",
    "Transition",
    "next_state",
]


class Command(enum.Enum):
    """Commands of the controlword 6040h; the value is (mask, pattern) over bits 3 to 0."""

    DISABLE_VOLTAGE = (0b0010, 0b0000)
    """Take the voltage away at once."""
    QUICK_STOP = (0b0110, 0b0010)
    """Stop the axis by 605Ah."""
    SHUTDOWN = (0b0111, 0b0110)
    """Make the drive ready to be switched on."""
    SWITCH_ON = (0b1111, 0b0111)
    """Switch the power on; the same word is Disable operation when operation is enabled."""
    ENABLE_OPERATION = (0b1111, 0b1111)
    """Drive the motor by the mode."""

    @classmethod
    def of(cls, controlword: int) -> Command:
        """The command that a controlword gives.

        >>> Command.of(0x000F)
        <Command.ENABLE_OPERATION: (15, 15)>
        """
        return next(c for c in cls if controlword & c.value[0] == c.value[1])


class Transition(NamedTuple):
    """One row of the state machine: `number` from `source` to `target` when all of it holds.

    >>> next(row for row in TRANSITIONS if row.number == 4).command
    <Command.ENABLE_OPERATION: (15, 15)>
    """

    number: int
    source: DriveState | None
    target: DriveState
    command: Command | None = None
    """Needed command; None: the transition does not look at the command."""
    when: str = ""
    """A condition of `CONDITIONS` that must hold too; "" is none."""


class Situation(NamedTuple):
    """What the state machine decides by, apart from its state.

    The controlword and the one before, 605Ah, 605Bh and 605Ch, and whether there is power, a fault
    to react to, a cause of the fault still, and whether the axis stands.

    >>> next_state(DriveState.FAULT, Situation(controlword=0x80))[0].name
    'SWITCH_ON_DISABLED'
    """

    controlword: int = 0
    previous: int = 0
    quick_stop_option: int = 2
    shutdown_option: int = 0
    disable_option: int = 1
    power: bool = True
    fault: bool = False
    cause: bool = False
    standing: bool = True


#: What `Transition.when` says, as a test of the situation.
CONDITIONS: dict[str, Callable[[Situation], bool]] = {
    "": lambda s: True,
    "a fault": lambda s: s.fault,
    "power": lambda s: s.power,
    "standing": lambda s: s.standing,
    "605Bh = 0 or standing": lambda s: s.shutdown_option == 0 or s.standing,
    "605Ch = 0 or standing": lambda s: s.disable_option == 0 or s.standing,
    "605Ah = 0, or 1..4 and standing": lambda s: (
        s.quick_stop_option == 0 or (s.quick_stop_option < 5 and s.standing)
    ),
    "605Ah = 5..8": lambda s: s.quick_stop_option >= 5,
    "reset edge, cause gone": lambda s: bool(s.controlword & ~s.previous & 0x80) and not s.cause,
}

_S, _C = DriveState, Command

TRANSITIONS: tuple[Transition, ...] = (
    Transition(0, None, _S.NOT_READY_TO_SWITCH_ON),
    Transition(13, _S.NOT_READY_TO_SWITCH_ON, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.SWITCH_ON_DISABLED, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.READY_TO_SWITCH_ON, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.SWITCHED_ON, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.OPERATION_ENABLED, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(13, _S.QUICK_STOP_ACTIVE, _S.FAULT_REACTION_ACTIVE, when="a fault"),
    Transition(1, _S.NOT_READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED),
    Transition(2, _S.SWITCH_ON_DISABLED, _S.READY_TO_SWITCH_ON, _C.SHUTDOWN, "power"),
    Transition(7, _S.READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED, _C.DISABLE_VOLTAGE),
    Transition(7, _S.READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED, _C.QUICK_STOP),
    Transition(3, _S.READY_TO_SWITCH_ON, _S.SWITCHED_ON, _C.SWITCH_ON),
    Transition(3, _S.READY_TO_SWITCH_ON, _S.SWITCHED_ON, _C.ENABLE_OPERATION),  # and 4 at once
    Transition(10, _S.SWITCHED_ON, _S.SWITCH_ON_DISABLED, _C.DISABLE_VOLTAGE),
    Transition(10, _S.SWITCHED_ON, _S.SWITCH_ON_DISABLED, _C.QUICK_STOP),
    Transition(6, _S.SWITCHED_ON, _S.READY_TO_SWITCH_ON, _C.SHUTDOWN),
    Transition(4, _S.SWITCHED_ON, _S.OPERATION_ENABLED, _C.ENABLE_OPERATION),
    Transition(9, _S.OPERATION_ENABLED, _S.SWITCH_ON_DISABLED, _C.DISABLE_VOLTAGE),
    Transition(11, _S.OPERATION_ENABLED, _S.QUICK_STOP_ACTIVE, _C.QUICK_STOP),
    Transition(
        8, _S.OPERATION_ENABLED, _S.READY_TO_SWITCH_ON, _C.SHUTDOWN, "605Bh = 0 or standing"
    ),
    Transition(5, _S.OPERATION_ENABLED, _S.SWITCHED_ON, _C.SWITCH_ON, "605Ch = 0 or standing"),
    Transition(12, _S.QUICK_STOP_ACTIVE, _S.SWITCH_ON_DISABLED, _C.DISABLE_VOLTAGE),
    Transition(
        12, _S.QUICK_STOP_ACTIVE, _S.SWITCH_ON_DISABLED, when="605Ah = 0, or 1..4 and standing"
    ),
    Transition(16, _S.QUICK_STOP_ACTIVE, _S.OPERATION_ENABLED, _C.ENABLE_OPERATION, "605Ah = 5..8"),
    Transition(14, _S.FAULT_REACTION_ACTIVE, _S.FAULT, when="standing"),
    Transition(15, _S.FAULT, _S.SWITCH_ON_DISABLED, when="reset edge, cause gone"),
)
"""The state machine, in the order of decision: the first row that fits is taken, one per period.

Only Enable operation in Ready to switch on runs two rows in one period, 3 and then 4.
Bit 7 counts by its rising edge in Fault and nowhere else: held, it blocks no command.
"""


def next_state(state: DriveState, situation: Situation) -> tuple[DriveState, tuple[int, ...]]:
    """The state one period later and the numbers of the transitions that ran, by `TRANSITIONS`.

    >>> next_state(DriveState.SWITCH_ON_DISABLED, Situation(controlword=0x0006))[1]
    (2,)
    """
    command = Command.of(situation.controlword)
    for row in TRANSITIONS:
        if (
            row.source is state
            and row.command in (None, command)
            and CONDITIONS[row.when](situation)
        ):
            if row.number == 3 and command is Command.ENABLE_OPERATION:
                return DriveState.OPERATION_ENABLED, (3, 4)
            return row.target, (row.number,)
    return state, ()
