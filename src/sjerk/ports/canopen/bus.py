"""Buses of python-can, which comes with the extra ``canopen``: load this module by need.

Never here: what a frame means.
"""

from __future__ import annotations

from typing import Any

import can

from sjerk.ports.canopen.frames import Send

#: What a bus raises when it fails.
BusErrors = (can.CanError, OSError)
#: What opening a bus raises.
OpenErrors = (can.CanError, OSError, ValueError, TypeError, ImportError)


def sender(bus: Any) -> Send:
    """The `Send` of a bus."""

    def send(identifier: int, data: bytes) -> None:
        bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    return send


def open_bus(interface: str, channel: str, **options: Any) -> Any:
    """A bus by its interface and channel, as python-can names them; raises `OpenErrors`."""
    return can.Bus(interface=interface, channel=channel, **options)
