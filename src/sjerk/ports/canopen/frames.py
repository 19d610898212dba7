"""Frames of a CAN bus as this port knows them, and how they get onto a bus of python-can.

Never here: what a frame means.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from sjerk.extras import load

#: Puts a frame on the bus: identifier (11 bits) and data (at most 8 bytes).
Send = Callable[[int, bytes], None]


class Frame(Protocol):
    """What a port needs of ``can.Message``."""

    arbitration_id: int
    data: bytearray
    is_extended_id: bool
    is_remote_frame: bool
    is_error_frame: bool


def sender(bus: Any) -> Send:
    """The `Send` of a bus of python-can; raises `ExtraMissingError` without sjerk[canopen]."""
    send: Send = load("sjerk.ports.canopen.bus", extra="canopen").sender(bus)
    return send
