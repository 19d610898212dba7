"""The states of the application layer (ETG.1000.6, 5.3.1) and the codes of their refusals.

`refusal` is the state machine itself: which request is possible from which state. What a transition
then demands of SyncManagers, mapping and clocks is the subdevice's.

Never here: registers, time.
"""

from __future__ import annotations

import enum


class AlState(enum.IntEnum):
    """State in 0130h, bits 0 to 3."""

    INIT = 1
    """No mailbox, no process data."""
    PREOP = 2
    """Mailbox."""
    BOOT = 3
    """Firmware download; not offered."""
    SAFEOP = 4
    """Mailbox, inputs; outputs are not applied."""
    OP = 8
    """Everything."""


ERROR = 0x10
"""Bit of 0130h: the state was refused or left by itself; in 0120h: acknowledged."""


class AlCode(enum.IntEnum):
    """AL status code 0134h: why."""

    NONE = 0x0000
    """All is well."""
    INVALID_CHANGE = 0x0011
    """No such transition."""
    UNKNOWN_STATE = 0x0012
    """No such state."""
    NO_BOOT = 0x0013
    """Boot is not offered."""
    MAILBOX = 0x0016
    """SM0 or SM1 is not as the SII says."""
    SYNC_MANAGER = 0x0017
    """SM2 or SM3 lies where it may not, or runs the wrong way."""
    SYNC_LOST = 0x001A
    """Too many periods without outputs."""
    WATCHDOG = 0x001B
    """No outputs for the time of the SyncManager watchdog."""
    OUTPUT_LENGTH = 0x001D
    """SM2 is not as long as the mapping."""
    INPUT_LENGTH = 0x001E
    """SM3 is not as long as the mapping."""
    OUTPUT_MAPPING = 0x0024
    """1C12h names what cannot be received."""
    INPUT_MAPPING = 0x0025
    """1C13h names what cannot be sent."""
    NO_SYNC_SUPPORT = 0x0028
    """This drive does not run without SYNC0."""
    NO_SYNC = 0x002D
    """SYNC0 is configured and never came."""
    DC_CONFIGURATION = 0x0030
    """Synchronisation by SYNC0 and its registers do not fit."""
    SYNC_CYCLE = 0x0035
    """1C32h:2 is no period the drive can run."""
    SYNC0_CYCLE = 0x0036
    """09A0h is no cycle the drive can run."""
    SYNC1_CYCLE = 0x0037
    """09A4h is no cycle the drive can run."""


_UP = {
    (AlState.INIT, AlState.PREOP),
    (AlState.PREOP, AlState.SAFEOP),
    (AlState.SAFEOP, AlState.OP),
}


def refusal(current: AlState, requested: int) -> AlCode:
    """Why a request is impossible whatever the configuration, or `AlCode.NONE`.

    >>> refusal(AlState.INIT, AlState.OP).name
    'INVALID_CHANGE'
    """
    if requested == AlState.BOOT:
        return AlCode.NO_BOOT
    if requested not in (AlState.INIT, AlState.PREOP, AlState.SAFEOP, AlState.OP):
        return AlCode.UNKNOWN_STATE
    target = AlState(requested)
    if target > current and (current, target) not in _UP:
        return AlCode.INVALID_CHANGE
    return AlCode.NONE
