"""Playing followed trajectories in a kernel: segments through the ring, and the handle of a path.

``Host.follow`` makes a ``Path``. The kernel plays it in its cycle (``_path.c``); here its segments
are fed as the ring takes them, so a path of any length needs constant memory. Never here: planning,
the layout of the memory.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk._binding import ffi, lib
from sjerk.errors import (
    InputError,
    MotionStoppedError,
    SupersededError,
    real,
)
from sjerk.host.commander import Commander, Unsent
from sjerk.host.feedback import PathState, limits_of
from sjerk.trajectory.segments import Followed
from sjerk.trajectory.trajectory import Trajectory

#: Records made at a time: memory, and how long the kernel's ring is left alone meanwhile.
_SLICE = 256
_ENDED = (
    PathState.DONE,
    PathState.STOPPED,
    PathState.LEFT,
    PathState.REFUSED,
    PathState.SUPERSEDED,
)


_NAMES = ("velocity", "acceleration", "jerk")

#: What is played: consecutive segments; None where the next ones are not there yet.
Blocks = Followed | Iterable[Followed | None]


@dataclass(frozen=True)
class Progress:
    """How far a path is, by the newest feedback.

    ``point``: the way-point ahead; ``time`` (s): passed since the one before, in the path's own
    time; ``speed``: 1 as planned; ``known``: the last way-point that the kernel has; ``fed``: the
    last one that was sent to it; ``complete``: whether that is the path's end.
    """

    point: int
    time: float
    speed: float
    known: int
    fed: int
    complete: bool


class Path:
    """Handle of a followed trajectory in a kernel; ``await path`` does what ``wait`` does.

    Its axes are ``AxisState.SYNCHRONIZED_MOTION``. At full speed the commanded samples are those of
    ``Followed.sample()`` bit for bit. ``pause``, ``speed`` and ``cancel`` change the speed *on the
    path*, within the limits of all axes in every cycle: the stop does not leave it, and after
    ``resume`` the samples are those of ``sample()`` again. Where segments do not come in time the
    motion comes to rest on the path and goes on by itself when they do.
    """

    def __init__(
        self,
        host: Commander,
        blocks: Blocks,
        axes: Sequence[int],
        *,
        replaces: Path | None = None,
        at: int = 0,
        after: int = 0,
    ) -> None:
        """Not for callers: ``Host.follow`` makes it; ``splice`` with the path it ``replaces``."""
        self._host = host
        self._axes = list(axes)
        self._rows = _dtype(host._axes)
        self._speed, self._paused = 1.0, False
        self._fed, self._complete = 0, False
        self._sent: list[tuple[int, NDArray[Any]]] = []  # ring number of the last record, batch
        self._error: BaseException | None = None
        self._waiting = np.empty(0, dtype=self._rows)
        self._stop = threading.Event()
        self._feeding = threading.RLock()
        self._yields = False  # another path is to take over, and the kernel has not said yet
        self._replaces = replaces  # until the kernel has said
        self._frame = ffi.new("sj_feedback *")
        self._number = ffi.new("uint64_t *")
        self._ended: PathState | None = None
        self._thread: threading.Thread | None = None
        with host._lock:
            self._goal_id = host._next_goal()
            self._unsent = Unsent(self._axes)  # until its first record is in the ring
            host._unsent.add(self._unsent)
        self._root: int = self._goal_id if replaces is None else replaces._root
        self._start: list[float] = []  # asked for, where the path is one of its own
        self._peaks = np.zeros((3, len(self._axes)))  # velocity, acceleration, jerk of what is sent
        source = iter((blocks,) if isinstance(blocks, Followed) else _blocks(blocks))
        self._records = self._made(source, at, after)
        self._first_record = 0  # its number in the ring
        self._waiting = self._next()  # at once, so that what is wrong is told here
        if replaces is not None:
            replaces._give_way(at + (after > 0))
            self._speed, self._paused = replaces._speed, replaces._paused
            self._send()
        if self._host._cyclic:
            self._begin_feeding()
        else:
            self.pump()

    # ---- feeding

    def _made(
        self, blocks: Iterator[Followed | None], at: int, after: int
    ) -> Iterator[NDArray[Any]]:
        """Records of the blocks, at most ``_SLICE`` at a time, the first one opening the path.

        One is held back until it is known whether it is the last. ``at``, ``after``: where in the
        path in play these go on, as for ``splice``; ``at`` 0 for a path of its own.
        """
        held = np.empty(0, dtype=self._rows)
        begin = at + (after > 0)
        expected = shift = -1
        for block in blocks:
            if block is None:
                yield held[:0]
                continue
            if not isinstance(block, Followed):
                raise InputError("blocks", block, "must hold what follow() gives, or None")
            if expected < 0:
                expected = block.first if at else 0
                shift = begin - 1 - block.first if at else 0
                self._check(block, expected)
                yield self._opening(block, at, after)
            self._check(block, expected)
            expected = block.first + len(block)
            for i in range(0, len(block), _SLICE):
                some = self._segments(block, i, min(i + _SLICE, len(block)), shift)
                if len(held):
                    yield held
                if len(some) > 1:
                    yield some[:-1]
                held = some[-1:]
        if not len(held):
            raise InputError("blocks", "no segments", "must hold at least one segment")
        held["last"] = 1
        yield held

    def _next(self) -> NDArray[Any]:
        """What is to be sent next; nothing where it is not there yet."""
        rows = next(self._records)
        if self._replaces is not None and not self._first_record and len(rows):
            # nothing may be missing once the kernel has taken over
            rows = self._joined([rows, next(self._records)])
        return rows

    def _check(self, block: Followed, expected: int) -> None:
        joints = block.position.shape[1]
        if joints != len(self._axes):
            raise InputError("axes", self._axes, f"must be one per joint: {joints}")
        if abs(block.cycle_time - self._host._T) > 1e-9 * self._host._T:
            raise InputError("cycle_time", block.cycle_time, f"the kernel's is {self._host._T!r}")
        if block.first != expected:
            raise InputError("first", block.first, f"blocks must follow each other: {expected}")

    def _empty(self, count: int) -> NDArray[Any]:
        rows = np.zeros(count, dtype=self._rows)
        rows["goal_id"] = self._goal_id
        rows["axis"]["kind"][:, self._axes] = lib.SJ_GOAL_ABSOLUTE
        return rows

    def _joined(self, parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """One after the other, in the layout of the ring (``np.concatenate`` would close gaps)."""
        rows = np.zeros(sum(map(len, parts)), dtype=self._rows)
        first = 0
        for part in parts:
            rows[first : first + len(part)] = part
            first += len(part)
        return rows

    def _opening(self, block: Followed, at: int, after: int) -> NDArray[Any]:
        row = self._empty(1)
        row["kind"], row["number"] = lib.SJ_RECORD_PATH, at
        row["cycles"][:, 0] = after
        self._start = [] if at else block.position[0].tolist()
        row["axis"]["position"][0, self._axes] = block.position[0]
        return row

    def _segments(self, block: Followed, low: int, high: int, shift: int) -> NDArray[Any]:
        T, rows = block.cycle_time, self._empty(high - low)
        self._peaks = np.maximum(self._peaks, _peaks(block, low, high))
        rows["kind"] = lib.SJ_RECORD_SEGMENT
        begin = block.first + shift + 1
        rows["number"] = np.arange(begin + low, begin + high)
        rows["cycles"] = block.lengths[low:high]
        axis = rows["axis"]
        axis["position"][:, self._axes] = block.position[low + 1 : high + 1]
        axis["velocity"][:, self._axes] = block.velocity[low:high] * T
        axis["acceleration"][:, self._axes] = block.acceleration[low:high] * T**2
        axis["last_jerk"][:, self._axes] = block.last_jerk[low:high] * T**3
        axis["jerk"][:, self._axes] = (block.jerk[low:high] * T**3).transpose(0, 2, 1)
        return rows

    def pump(self) -> bool:
        """Send as many segments as the ring has room for; whether all have been sent.

        For a caller's own loop: call it now and then between ``MotionKernel.step``. With a process
        a thread does it. Raises what the source of the blocks raises, once; the path is cancelled.
        """
        while True:
            with self._feeding:
                sent = self._push()
            if sent is not None:
                return sent
            try:
                rows = self._next()
            except BaseException as error:
                self._fail(error)
                raise
            with self._feeding:
                self._waiting = self._joined([self._waiting, rows]) if len(self._waiting) else rows
            if not len(rows):
                return False

    def _push(self) -> bool | None:
        """Send what waits; whether all has been sent, None: the next of it is needed."""
        if self._error is not None or (self._host._cyclic and self._host._closed):
            return True
        if self._is_refused() or (not self._first_record and self.state in _ENDED):
            return True
        while len(self._waiting) and not self._complete:
            if not self._send():
                return False
        return self._replaces is None if self._complete else None

    def _is_refused(self) -> bool:
        """Whether the kernel has refused the splice; then the path before goes on."""
        before = self._replaces
        if before is None:
            return False
        state = self.state
        if state is PathState.SENT:
            return False
        self._replaces = None
        if state is not PathState.REFUSED:
            return False
        self._complete = True
        before._go_on()
        return True

    def _send(self) -> bool:
        """Some of what waits; False: there is no room, or another path is to take over."""
        segment = self._host._segment
        with self._feeding:
            room = segment.layout.record_capacity - lib.sj_ring_waiting(segment.base)
            count = min(room, len(self._waiting))
            if count <= 0 or self._yields or (not self._first_record and self.state in _ENDED):
                return False
            part = np.ascontiguousarray(self._waiting[:count])
            with self._host._lock:
                if not self._first_record and not self._unsent.free:
                    return False
                number = self._host._publish_records(ffi.from_buffer(part), count)
                if not number:
                    return False
                self._first_record = self._first_record or number - count + 1
                self._host._unsent.discard(self._unsent)
            self._waiting = self._waiting[count:]
            if part["kind"][-1] == lib.SJ_RECORD_SEGMENT:
                self._fed = int(part["number"][-1])
                done = lib.sj_ring_taken(segment.base) - lib.SJ_AHEAD
                self._sent = [sent for sent in self._sent if sent[0] > done] + [(number, part)]
            self._complete = bool(part["last"][-1])
        return True

    def _begin_feeding(self) -> None:
        self._thread = threading.Thread(target=self._feed, daemon=True)
        self._host._fed.add(self)
        self._thread.start()

    def _feed(self) -> None:
        """The thread: until all is sent, or the path is over."""
        try:
            while not self._stop.is_set() and not self.pump() and not self._is_over():
                self._stop.wait(1e-3)
        except BaseException as error:
            if self._error is None:
                self._fail(error)

    def _fail(self, error: BaseException) -> None:
        """No more will come: ``wait`` is to raise this."""
        with self._feeding:
            self._error = error
            if not self._host._closed:
                self.cancel()

    def _is_over(self) -> bool:
        """Whether the thread is not needed any more."""
        with self._feeding:
            if self._host._closed:
                return True
            base = self._host._segment.base
            if lib.sj_feedback_read(base, self._frame, self._number) != 1:
                return False
            told = self._frame.path
            ended = told.goal_id == self._goal_id and PathState(told.state) in _ENDED
            return bool(told.goal_id > self._goal_id or ended)

    # ---- commanding

    def _order(self, *, cancel: int = 0) -> None:
        with self._host._lock:
            order = self._host._command.path
            order.goal_id, order.speed = self._root, self._speed
            order.pause, order.cancel = self._paused, cancel
            self._host._publish()

    def pause(self) -> None:
        """Come to rest on the path; ``resume`` goes on."""
        self._paused = True
        self._order()

    def resume(self) -> None:
        """Go on along the path, up to the speed that was set."""
        self._paused = False
        self._order()

    def speed(self, factor: float) -> None:
        """Pass the path at another speed, 0 .. 2; 1 is as planned. Times the kernel's override.

        Above 1 as far and as long as the limits of all axes allow it. 0 waits as ``pause`` does.
        Raises InputError.
        """
        if not 0.0 <= real("factor", factor) <= 2.0:
            raise InputError("factor", factor, "must lie in 0 .. 2")
        self._speed = factor
        self._order()

    def cancel(self) -> None:
        """Come to rest on the path and forget the rest of it; nothing if it is over."""
        self._stop.set()
        if self.state in _ENDED:
            return
        alone = self._replaces is None
        if self._host._end(self._unsent, lib.SJ_RESULT_SUPERSEDED):
            if not alone:
                self._order(cancel=1)
            return
        self._host._cancels_taken()
        with self._host._lock:
            self._host._take_back(self._first_record, self._axes)
        if alone and not self._is_open():
            self._host._cancels_taken()  # or it has been opened meanwhile
            if not self._is_open():
                return  # and an order to it would end those of the path in play
        self._order(cancel=1)

    def _is_open(self) -> bool:
        """Whether the kernel has opened it, begun or not."""
        return bool(self._host._frame().path.goal_id == self._goal_id)

    def splice(self, blocks: Blocks, at: int, *, after: int = 0) -> Path:
        """Go on along other segments; this path is superseded by the new one.

        They take over at way-point ``at - 1`` of this path, or so many cycles ``after`` it on the
        way to ``at``, in the state in which it passes there (velocity, acceleration, jerk of the
        cycle before): its own, or that of a plan with the same way-points around it. The place
        where they take over is a way-point then; numbers go on from there. Speed and pause are
        kept; until the kernel has answered, orders to either path are for both. Raises InputError
        where the place has been passed, or has not been sent. Where the kernel finds that it has
        been passed or is counted on, the new path is refused, and this one goes on as it was.
        """
        progress = self.progress
        for name, value in (("at", at), ("after", after)):
            if isinstance(value, bool) or not isinstance(value, int) or value < 0:
                raise InputError(name, value, "must be an int, not negative")
        if after > lib.SJ_CYCLES_MAX:
            raise InputError("after", after, f"must be up to {lib.SJ_CYCLES_MAX} cycles")
        if at < progress.point + (after == 0):
            raise InputError("at", at, f"the way-point ahead is {progress.point}")
        if at > progress.fed + (after == 0):
            raise InputError("at", at, f"sent are way-points up to {progress.fed}")
        if self._yields:
            raise InputError("at", at, "another path is to take over already")
        self._host._cancels_taken()
        return Path(self._host, blocks, self._axes, replaces=self, at=at, after=after)

    def _give_way(self, first: int) -> None:
        """Take back what the kernel has not taken of way-points from ``first``; wait with more."""
        with self._feeding:
            self._yields = True
            for number, part in self._sent:
                points = part["number"]
                if points[-1] >= first:
                    left = int((points >= first).sum())
                    with self._host._lock:
                        self._host._take_back(number - left + 1, self._axes)
                    return

    def _go_on(self) -> None:
        """No other path has taken over: send again what was taken back, and go on."""
        known = self.progress.known
        with self._feeding:
            again = [
                part[(part["kind"] == lib.SJ_RECORD_SEGMENT) & (part["number"] > known)]
                for _, part in self._sent
            ]
            self._waiting = self._joined([*again, self._waiting])
            self._sent, self._yields = [], False
            was, self._complete = self._complete, self._complete and not len(self._waiting)
        if self._thread is not None and was and not self._complete:
            self._thread.join()  # its work was done
            self._begin_feeding()

    # ---- what has become of it

    @property
    def axes(self) -> tuple[int, ...]:
        """Axis numbers, in the order of the joints."""
        return tuple(self._axes)

    @property
    def goal_id(self) -> int:
        """Number of this goal in feedback and events."""
        return self._goal_id

    @property
    def state(self) -> PathState:
        """What has become of it, by the newest feedback."""
        return self._state(self._host._frame())

    @property
    def done(self) -> bool:
        """Whether the command is on the last way-point."""
        return self.state is PathState.DONE

    @property
    def progress(self) -> Progress:
        """How far it is."""
        told = self._host._frame().path
        mine = told.goal_id == self._goal_id
        return Progress(
            point=int(told.number) if mine else 0,
            time=float(told.cycle) * self._host._T if mine else 0.0,
            speed=float(told.speed) if mine else 0.0,
            known=int(told.known) if mine else 0,
            fed=self._fed,
            complete=self._complete,
        )

    def _state(self, frame: Any) -> PathState:
        if self._ended is None:
            state = self._state_now(frame)
            if state not in _ENDED:
                return state
            self._ended = state
            self._stop.set()
        return self._ended

    def _state_now(self, frame: Any) -> PathState:
        told = frame.path
        if not self._first_record:
            return self._unsent_state(frame)
        if told.goal_id == self._goal_id:
            state = PathState(told.state)
            refused = told.result != lib.SJ_RESULT_ACCEPTED
            return PathState.REFUSED if refused and state in _ENDED else state
        result = self._host._result(self._goal_id, frame)
        if result is not None and result[0] == lib.SJ_RESULT_SUPERSEDED:
            return PathState.SUPERSEDED
        if result is not None and result[0] == lib.SJ_RESULT_STOPPED:
            return PathState.STOPPED
        if result is not None and result[0] != lib.SJ_RESULT_ACCEPTED:
            return PathState.REFUSED
        if told.goal_id > self._goal_id:
            last = PathState(self._host._path_states.get(self._goal_id, lib.SJ_PATH_NONE))
            return last if last in _ENDED else PathState.SUPERSEDED
        return PathState.SENT

    def _unsent_state(self, frame: Any) -> PathState:
        """Answered by what came for its axes, or by what has become of the path before."""
        host, before = self._host, self._replaces
        result = host._never_sent(self._unsent, frame)
        if result is None and before is not None and before._state(frame) in _ENDED:
            host._end(self._unsent, lib.SJ_RESULT_STOPPED)
            result = self._unsent.result
        if result is None:
            return PathState.SENT
        stopped = result == lib.SJ_RESULT_STOPPED
        return PathState.STOPPED if stopped else PathState.SUPERSEDED

    def wait(self, timeout: float | None = None) -> None:
        """Return when the command is on the last way-point.

        Raises RefusedError (with the reason), SupersededError (another path took over),
        MotionStoppedError (stopped, or left the path), what the source of the blocks raised,
        KernelGoneError, TimeoutError.
        """
        self._host._wait_until(
            lambda frame: self._state(frame) in _ENDED, timeout, f"path {self._goal_id}"
        )
        self._raise()

    def __await__(self) -> Generator[Any, None, None]:
        return self._settle().__await__()

    async def _settle(self) -> None:
        while self.state not in _ENDED:
            self._host._alive("a path")
            await asyncio.sleep(1e-3)
        self._raise()

    def _raise(self) -> None:
        frame = self._host._frame()
        state = self._state(frame)
        if self._error is not None:
            raise self._error
        if state is PathState.DONE:
            return
        position = {i: float(frame.axis[i].position) for i in self._axes}
        if state is PathState.REFUSED:
            code, axis = self._host._result(self._goal_id, frame) or (0, -1)
            if code in (lib.SJ_RESULT_NONE, lib.SJ_RESULT_ACCEPTED):
                code = frame.path.result
            axis, detail = self._reason(code, frame, axis)
            raise self._host._refusal(code, axis, detail)
        if state is PathState.SUPERSEDED:
            raise SupersededError(position)
        axes = {i: frame.axis[i] for i in self._axes}
        raise MotionStoppedError(
            position, {i: int(axis.error_code) for i, axis in axes.items() if axis.fault}
        )

    def _reason(self, code: int, frame: Any, axis: int) -> tuple[int, str]:
        """The axis that a refusal is about, or -1, and the values, as far as they are known here.

        Where the kernel names no ``axis`` it is the one that is furthest off.
        """
        found: list[tuple[float, int, str]] = []
        for k, i in enumerate(self._axes):
            if axis not in (-1, i):
                continue
            raw = frame.axis[i]
            if code == lib.SJ_RESULT_START and self._start:
                asked, now = self._start[k], float(raw.position)
                found.append(
                    (abs(asked - now), i, f"it begins at {asked!r}, the axis is at {now!r}")
                )
            elif code == lib.SJ_RESULT_LIMITS:
                own = limits_of(raw, self._host._T)
                least = (
                    own.velocity,
                    min(own.acceleration, own.deceleration or own.acceleration),
                    min(own.jerk, own.deceleration_jerk or own.jerk),
                )
                for name, value, most in zip(
                    _NAMES, self._peaks[:, k].tolist(), least, strict=True
                ):
                    text = f"{name} {value:g} on the path, the axis has {most:g}"
                    found.append((value / most - 1.0 - 1e-9, i, text))
        off, which, detail = max(found, default=(0.0, axis, ""))
        return (which, detail) if off > 0.0 else (axis, "")

    def stopped(self, timeout: float | None = None) -> None:
        """Return when it is over or at rest on the path, whatever the reason."""
        rests = (*_ENDED, PathState.PAUSED)
        self._host._wait_until(
            lambda frame: (
                self._state(frame) in rests
                or (self._state(frame) is PathState.STARVES and frame.path.speed == 0.0)
            ),
            timeout,
            f"path {self._goal_id} to rest",
        )


def _blocks(blocks: Any) -> Iterable[Followed | None]:
    """Refuse what is no source of blocks."""
    if isinstance(blocks, Trajectory):
        made = "follow(trajectory, limits, cycle_time) makes blocks of it"
        raise InputError("blocks", blocks, made)
    if isinstance(blocks, str) or not isinstance(blocks, Iterable):
        raise InputError("blocks", blocks, "must be a Followed, or an iterable of them")
    return blocks


def _peaks(block: Followed, low: int, high: int) -> NDArray[np.float64]:
    """Largest velocity, acceleration and jerk of some segments, at the ends of their phases."""
    at, push = block.velocity[low:high], block.acceleration[low:high]
    most = [np.abs(at), np.abs(push), np.abs(block.jerk[low:high]).max(axis=1)]
    for p in range(block.lengths.shape[1]):
        t, jerk = block.cycle_time * block.lengths[low:high, p, None], block.jerk[low:high, p]
        at, push = at + t * (push + t * jerk / 2.0), push + t * jerk
        most[0], most[1] = np.maximum(most[0], np.abs(at)), np.maximum(most[1], np.abs(push))
    return np.array([each.max(axis=0) for each in most])


def _dtype(axes: int) -> np.dtype[Any]:
    """``sj_record`` of so many axes as a structured type of numpy."""
    where = ffi.offsetof
    axis = np.dtype(
        {
            "names": ["kind", "position", "velocity", "acceleration", "last_jerk", "jerk"],
            "formats": ["i4", "f8", "f8", "f8", "f8", ("f8", (4,))],
            "offsets": [
                where("sj_axis_record", "goal") + where("sj_axis_goal", "kind"),
                *(
                    where("sj_axis_record", name)
                    for name in ("position", "velocity", "acceleration", "last_jerk", "jerk")
                ),
            ],
            "itemsize": ffi.sizeof("sj_axis_record"),
        }
    )
    names = ["goal_id", "number", "cycles", "kind", "last", "axis"]
    return np.dtype(
        {
            "names": names,
            "formats": ["u8", "u8", ("i8", (4,)), "i4", "i4", (axis, (axes,))],
            "offsets": [where("sj_record", name) for name in names],
            "itemsize": lib.sj_record_bytes(axes),
        }
    )
