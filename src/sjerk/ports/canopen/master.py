"""A kernel as the master of CANopen drives: process image by PDO around SYNC (extra ``canopen``).

`Master.exchange` is one cycle on the bus: targets out, SYNC, what the drives say in; `Master.run`
paces it by the clock together with `MotionKernel.step`. The drives watch the master's heartbeat
(1016h) and act by 6007h when it stays away. Never here: motion, a real-time bus: Python and
python-can decide how punctual a cycle is.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Mapping
from typing import Any

from sjerk._binding import lib
from sjerk.cia402 import DriveState
from sjerk.drive.objects import DISABLED
from sjerk.errors import InputError, positive
from sjerk.kernel import MotionKernel
from sjerk.ports.canopen.frames import sender
from sjerk.ports.canopen.sdo import SdoClient

#: Node number under which the master's heartbeat is sent.
MASTER = 127
#: Cycles in a row without an answer before an axis counts as lost.
PATIENCE = 3

_OUT = struct.Struct("<Hbi")  # 6040h, 6060h, 607Ah
_IN = struct.Struct("<Hbi")  # 6041h, 6061h, 6064h
_MORE = struct.Struct("<ihH")  # 606Ch, 6077h, 603Fh
_LIMITS = struct.Struct("<Ii")  # 60FDh, 60F4h
_FORWARD = struct.Struct("<ih")  # 60B1h, 60B2h
_OFFSETS = (0x60B10020, 0x60B20010)
_INPUTS = (0x60FD0020, 0x60F40020)
#: 1018h:2 of a drive of sjerk.
_OWN_PRODUCT = 0x5E4B0402


class Master:
    """The drives of a kernel's external axes on one bus of python-can.

    ``nodes``: node number by axis. The drives keep the default mapping of ``sjerk drive``, by
    SYNC, but the fourth transmit PDO has 60FDh and 60F4h, and the second receive PDO of an axis
    with ``feed_forward`` 60B1h and, with a torque, 60B2h. What a drive of sjerk would feed forward
    by itself as well is set to 0 (2102h); of another one it has to be off.
    ``heartbeat``: seconds between the master's, watched by the drives for ``lost`` times that.
    ``abort_option``: 6007h of the drives, what they do without their master (1 fault, 2 disable
    voltage, 3 quick stop). Raises ``InputError`` for nodes and cycle times that cannot be,
    ``SjerkError`` where a node does not answer. ``examples/06_canopen_master.py`` runs one.
    """

    def __init__(
        self,
        kernel: MotionKernel,
        bus: Any,
        nodes: Mapping[int, int],
        *,
        heartbeat: float = 0.05,
        lost: int = 5,
        abort_option: int = 1,
    ) -> None:
        """Set the drives up by SDO and start them; none is enabled by this."""
        for axis, node in nodes.items():
            if not 0 <= axis < len(kernel.axes) or kernel.axes[axis].drive != "external":
                raise InputError("nodes", axis, "must be numbers of external axes")
            if not 1 <= node < MASTER:
                raise InputError(f"nodes[{axis}]", node, f"must lie in 1 .. {MASTER - 1}")
        if len(set(nodes.values())) != len(nodes):
            raise InputError("nodes", dict(nodes), "must be a node of its own for each axis")
        self._kernel, self._bus, self._nodes = kernel, bus, dict(nodes)
        self._axis_of = {node: axis for axis, node in nodes.items()}
        self._send = sender(bus)
        self._image = kernel.image
        self._heartbeat = positive("heartbeat", heartbeat)
        self._beat_due = time.monotonic()
        self._missed = dict.fromkeys(nodes, 0)
        watch = MASTER << 16 | min(0xFFFF, max(1, round(1e3 * heartbeat * lost)))
        value, power = _interval(kernel.cycle_time)
        self._fed = {axis: _fed(kernel, axis) for axis in nodes}
        for axis, node in nodes.items():
            self._send(0x000, bytes((0x80, node)))  # pre-operational
            sdo = SdoClient(bus, node)
            sdo.write(0x60C2, 1, struct.pack("<B", value))
            sdo.write(0x60C2, 2, struct.pack("<b", power))
            sdo.write(0x6007, 0, struct.pack("<h", abort_option))
            for index in (0x1400, 0x1800, 0x1801):
                sdo.write(index, 2, b"\1")  # with each SYNC
            sdo.write(0x1801, 1, struct.pack("<I", 0x40000280 + node))
            _map(sdo, 0x1803, 0x40000480 + node, _INPUTS)
            if self._fed[axis]:
                _map(sdo, 0x1401, 0x300 + node, _OFFSETS[: self._fed[axis]])
                if sdo.read(0x1018, 2) == struct.pack("<I", _OWN_PRODUCT):
                    for sub in range(1, 1 + self._fed[axis]):
                        sdo.write(0x2102, sub, struct.pack("<f", 0.0))
            sdo.write(0x1016, 1, struct.pack("<I", watch))
        self._beat()
        for node in nodes.values():
            self._send(0x000, bytes((0x01, node)))
        self._kernel.step()  # outputs that enable nothing, before the first exchange

    def exchange(self, timeout: float) -> None:
        """Send the outputs and SYNC, take the inputs that come within ``timeout`` (s).

        It returns as soon as all have come. An axis that does not answer ``PATIENCE`` times in a
        row is stale until it does.
        """
        out = self._image.outputs
        for axis, node in self._nodes.items():
            row = out[axis]
            words = int(row["controlword"]), int(row["mode"]), int(row["target_position"])
            self._send(0x200 + node, _OUT.pack(*words))
            if self._fed[axis]:
                both = _FORWARD.pack(int(row["velocity_offset"]), int(row["torque_offset"]))
                self._send(0x300 + node, both[: 4 if self._fed[axis] == 1 else 6])
        self._send(0x080, b"")
        if time.monotonic() >= self._beat_due:
            self._beat()
        waiting, end = set(self._nodes), time.monotonic() + timeout
        while waiting and (left := end - time.monotonic()) > 0.0:
            frame = self._bus.recv(left)
            if frame is not None:
                self._take(frame.arbitration_id, bytes(frame.data), waiting)
        for axis in self._nodes:
            self._missed[axis] = self._missed[axis] + 1 if axis in waiting else 0
            if self._missed[axis] >= PATIENCE:
                self._image.stale[axis] = 1
            elif axis not in waiting:
                self._image.stale[axis] = 0

    def run(self, stop: Callable[[], bool]) -> None:
        """Exchange and step in every cycle time, or as fast as the bus allows, until ``stop()``."""
        due = time.monotonic()
        while not stop():
            self.exchange(max(0.05, 4.0 * self._kernel.cycle_time))
            self._kernel.step()
            due = max(due + self._kernel.cycle_time, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))

    def end(self) -> bool:
        """End the kernel as its process would: its axes come to rest, its drives are disabled.

        Exchanges until everything rests and every drive is disabled that still answers, at most two
        seconds of an axis at rest. Returns whether all answer and are disabled. The kernel takes no
        goal afterwards.
        """
        core = self._kernel.core
        core.ending = 1
        self.run(lambda: bool(lib.sj_kernel_at_rest(core)))
        _, mask, enabled = DriveState.OPERATION_ENABLED.value
        words, stale = self._image.inputs["statusword"], self._image.stale
        return not any(stale[i] or int(words[i]) & mask == enabled for i in self._nodes)

    def _beat(self) -> None:
        self._send(0x700 + MASTER, b"\x05")
        self._beat_due = time.monotonic() + self._heartbeat

    def _take(self, identifier: int, data: bytes, waiting: set[int]) -> None:
        axis = self._axis_of.get(identifier & 0x7F)
        if axis is None:
            return
        row = self._image.inputs[axis]
        if identifier & 0x780 == 0x180 and len(data) == _IN.size:
            row["statusword"], row["mode_display"], row["position_actual"] = _IN.unpack(data)
            waiting.discard(axis)
        elif identifier & 0x780 == 0x280 and len(data) == _MORE.size:
            row["velocity_actual"], row["torque_actual"], row["error_code"] = _MORE.unpack(data)
        elif identifier & 0x780 == 0x480 and len(data) == _LIMITS.size:
            row["digital_inputs"], row["following_error"] = _LIMITS.unpack(data)


def _fed(kernel: MotionKernel, axis: int) -> int:
    """How many of 60B1h and 60B2h an axis sends."""
    fed = kernel.axes[axis].fed_forward
    return 0 if fed is None else 1 if fed.rated_torque_nm is None else 2


def _map(sdo: SdoClient, index: int, word: int, objects: tuple[int, ...]) -> None:
    """A PDO by its communication record: mapped anew, with each SYNC, and enabled last."""
    mapping = index + 0x200
    sdo.write(index, 1, struct.pack("<I", word | DISABLED))
    sdo.write(mapping, 0, b"\0")
    for sub, entry in enumerate(objects, 1):
        sdo.write(mapping, sub, struct.pack("<I", entry))
    sdo.write(mapping, 0, bytes((len(objects),)))
    sdo.write(index, 2, b"\1")
    sdo.write(index, 1, struct.pack("<I", word))


def _interval(period_s: float) -> tuple[int, int]:
    """60C2h of a cycle time; raises InputError for one that it cannot hold."""
    for power in (-3, -4, -5, -6):
        value = period_s * 10.0**-power
        if 1 <= round(value) <= 255 and abs(value - round(value)) < 1e-6:
            return round(value), power
    raise InputError("cycle_time", period_s, "60C2h holds 1 .. 255 of 1e-6 .. 1e-3 s")
