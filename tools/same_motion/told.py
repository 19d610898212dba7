"""What a script told: columns of motion, and events as text; and how a kernel is run by one."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import astuple, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from adapter import columns, word
from sjerk import Host, MotionKernel, SjerkError, simulate

#: Commands a host between cycles; yields how many cycles are to pass.
Play = Callable[[Host], Generator[int]]


class Told:
    """Motion by columns, each in parts, and events in order."""

    def __init__(self) -> None:
        self.columns: dict[str, list[np.ndarray]] = {}
        self.events: list[str] = []
        self.refused = False  # the last attempt

    def motion(self, name: str, values: Any) -> None:
        """One more part of a column."""
        self.columns.setdefault(name, []).append(np.array(values))

    def samples(self, found: Any) -> None:
        """The columns of ``Samples``."""
        for name in ("time", "position", "velocity", "acceleration", "jerk"):
            self.motion(name, getattr(found, name))

    def event(self, kind: str, *values: object) -> None:
        """One line: the kind first, by which differences are counted."""
        self.events.append(" ".join([kind, *map(_text, values)]))

    def attempt(self, call: Callable[..., Any], *given: Any, **options: Any) -> Any:
        """What a call gives, or None where it refuses, which is an event."""
        self.refused = False
        try:
            return call(*given, **options)
        except SjerkError as error:
            self.refused = True
            self.event("raised", call.__name__, word(type(error)))
            return None


def _text(value: object) -> str:
    if isinstance(value, Enum):
        return word(value)
    if is_dataclass(value) and not isinstance(value, type):
        return _text(astuple(value))
    if isinstance(value, np.ndarray):
        return _text(value.tolist())
    if isinstance(value, tuple | list):
        return f"({', '.join(map(_text, value))})"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_text(k)}: {_text(v)}' for k, v in value.items())}}}"
    return str(value)


def run(told: Told, kernel: MotionKernel, play: Play, cycles: int) -> None:
    """So many cycles in virtual time, commanded by ``play`` as long as it goes on."""

    def script() -> Iterator[tuple[int, Callable[[Host], object]]]:
        hosts: list[Host] = []
        at = 1
        yield at, hosts.append
        playing = play(hosts[0])
        passing = 0

        def act(_: Host) -> None:
            nonlocal passing
            passing = next(playing, -1)

        while at <= cycles:
            yield at, act
            if passing < 0:
                break
            at += passing
        yield cycles, lambda _: playing.close()

    recording = simulate(kernel, script(), cycles)
    for name, column in columns(recording):
        told.motion(name, column)
    for one in recording.events:
        told.event(word(one.kind), one.cycle, one.axis, one.code, one.value, one.goal_id)
