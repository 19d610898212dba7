"""The states of an axis as in PLCopen (motion control, part 1), as a table to be read.

``_states.c`` is what runs in the cycle; the tests hold one against the other. Never here: drives.
"""

from __future__ import annotations

from enum import IntEnum

from sjerk._binding import lib


class AxisState(IntEnum):
    """What an axis does.

    >>> NEXT[AxisState.STANDSTILL, Trigger.MOVE].name
    'DISCRETE_MOTION'
    """

    DISABLED = lib.SJ_AXIS_DISABLED
    STANDSTILL = lib.SJ_AXIS_STANDSTILL
    DISCRETE_MOTION = lib.SJ_AXIS_DISCRETE
    CONTINUOUS_MOTION = lib.SJ_AXIS_CONTINUOUS
    SYNCHRONIZED_MOTION = lib.SJ_AXIS_SYNCHRONIZED
    HOMING = lib.SJ_AXIS_HOMING
    STOPPING = lib.SJ_AXIS_STOPPING
    ERROR_STOP = lib.SJ_AXIS_ERROR_STOP


class Trigger(IntEnum):
    """What leads from one state to the next: commands, and what the drive does."""

    POWER_ON = lib.SJ_TRIGGER_POWER_ON
    POWER_OFF = lib.SJ_TRIGGER_POWER_OFF
    FAULT = lib.SJ_TRIGGER_FAULT
    RESET = lib.SJ_TRIGGER_RESET
    MOVE = lib.SJ_TRIGGER_MOVE
    JOG = lib.SJ_TRIGGER_JOG
    SYNCHRONIZE = lib.SJ_TRIGGER_SYNCHRONIZE
    HOME = lib.SJ_TRIGGER_HOME
    HALT = lib.SJ_TRIGGER_HALT
    QUICK_STOP = lib.SJ_TRIGGER_QUICK_STOP
    DONE = lib.SJ_TRIGGER_DONE


_S, _T = AxisState, Trigger
_MOVING = (_S.DISCRETE_MOTION, _S.CONTINUOUS_MOTION, _S.SYNCHRONIZED_MOTION)
_POWERED = (_S.STANDSTILL, *_MOVING, _S.HOMING, _S.STOPPING)

#: The next state by state and trigger. What is missing is refused.
NEXT: dict[tuple[AxisState, Trigger], AxisState] = {
    # without power nothing moves; a stop has nothing to do
    (_S.DISABLED, _T.POWER_ON): _S.STANDSTILL,
    (_S.DISABLED, _T.FAULT): _S.ERROR_STOP,
    **{
        (_S.DISABLED, trigger): _S.DISABLED
        for trigger in (_T.POWER_OFF, _T.RESET, _T.HALT, _T.QUICK_STOP, _T.DONE)
    },
    # an error ends by a reset only
    **{
        (_S.ERROR_STOP, trigger): _S.ERROR_STOP
        for trigger in (_T.POWER_ON, _T.POWER_OFF, _T.FAULT, _T.HALT, _T.QUICK_STOP, _T.DONE)
    },
    (_S.ERROR_STOP, _T.RESET): _S.DISABLED,
    # with power
    **{(state, _T.POWER_ON): state for state in _POWERED},
    **{(state, _T.RESET): state for state in _POWERED},
    **{(state, _T.POWER_OFF): _S.DISABLED for state in _POWERED},
    **{(state, _T.FAULT): _S.ERROR_STOP for state in _POWERED},
    **{(state, _T.QUICK_STOP): _S.STOPPING for state in _POWERED},
    **{(state, _T.DONE): _S.STANDSTILL for state in _POWERED},
    # goals: from rest, and each replaces the one before
    **{(state, _T.MOVE): _S.DISCRETE_MOTION for state in (_S.STANDSTILL, *_MOVING)},
    **{(state, _T.JOG): _S.CONTINUOUS_MOTION for state in (_S.STANDSTILL, *_MOVING)},
    **{(state, _T.SYNCHRONIZE): _S.SYNCHRONIZED_MOTION for state in (_S.STANDSTILL, *_MOVING)},
    (_S.STANDSTILL, _T.HOME): _S.HOMING,
    # a halt is a motion that the next goal replaces, except in homing
    (_S.STANDSTILL, _T.HALT): _S.STANDSTILL,
    **{(state, _T.HALT): _S.DISCRETE_MOTION for state in _MOVING},
    (_S.HOMING, _T.HALT): _S.STOPPING,
    (_S.STOPPING, _T.HALT): _S.STOPPING,
}
