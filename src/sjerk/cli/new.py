"""``sjerk new``: the TOML file of a kernel, from questions or from options.

Every value is checked by the kernel that it describes before the file is written. Never here: what
a field means to a kernel.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sjerk.errors import InputError, SjerkError
from sjerk.kernel import MotionKernel, described

#: Units of one turn of an axis, by its unit.
_TURN = {"deg": 360.0, "rad": 2.0 * math.pi, "turn": 1.0, "rev": 1.0}
_DRIVES = ("simulated", "ideal", "external")
_WHOLE = "as in `sjerk new robot.toml --names axis --velocity 90 --acceleration 500 --jerk 5000`"


def _size(word: str) -> float:
    value = float(word)
    if not 0.0 < value < math.inf:
        raise ValueError(word)
    return value


def _end(word: str) -> float | None:
    return None if word == "-" else float(word)


def _drive(word: str) -> str:
    if word not in _DRIVES:
        raise ValueError(word)
    return word


#: What to type, for somebody who typed something else, by what becomes of it.
_HELP: dict[Callable[[str], Any], str] = {
    str: "words without spaces, as in: shoulder elbow",
    _size: "numbers greater than 0, one for all axes or one for each, as in: 90 or 90 180",
    _end: "numbers, or - for none; one for all axes or one for each, as in: -170 or -170 -",
    _drive: f"{', '.join(_DRIVES)}; one for all axes or one for each",
}


@dataclass(frozen=True)
class Question:
    """One value or one per axis: its option, the question, how a word becomes it, a default."""

    name: str
    text: str
    kind: Callable[[str], Any]
    default: str | None = None


_QUESTIONS = (
    Question("names", "names of the axes, in the order of the joints", str),
    Question("unit", "unit of the axes", str, "deg"),
    Question("per_turn", "units in one turn behind the gear", _size),
    Question("increments", "increments of the encoder in one turn of the motor", _size, "16777216"),
    Question("gear", "turns of the motor in one turn of the axis", _size, "1"),
    Question("velocity", "largest velocity, unit/s", _size),
    Question("acceleration", "largest acceleration, unit/s^2", _size),
    Question("jerk", "largest jerk, unit/s^3", _size),
    Question("low", "lowest position, unit; - for none", _end, "-"),
    Question("high", "highest position, unit; - for none", _end, "-"),
    Question("drive", f"drives: {', '.join(_DRIVES)}", _drive, "simulated"),
)


def add_arguments(jobs: Any) -> None:
    """Add new."""
    text = "write the TOML file of a kernel; asks for what no option gives"
    job = jobs.add_parser("new", help=text)
    job.add_argument("file", type=Path, help="to be written, as robot.toml")
    for question in _QUESTIONS:
        option = f"--{question.name.replace('_', '-')}"
        job.add_argument(option, nargs="+", help=f"{question.text}; one for all, or one per axis")
    job.add_argument("--cycle-time", type=float, default=1e-3, help="s (default: 0.001)")
    job.add_argument("--priority", type=int, default=0, help="of SCHED_FIFO (default: none)")
    job.add_argument("--yes", action="store_true", help="ask nothing: take defaults")
    job.add_argument("--force", action="store_true", help="overwrite a file that exists")
    job.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Ask, check, write, and say what comes next."""
    if options.file.exists() and not options.force:
        raise InputError("file", str(options.file), "exists: --force overwrites it")
    asks = not options.yes and sys.stdin.isatty()
    words = _answers(options, asks)
    text = description(words, cycle_time=options.cycle_time, priority=options.priority)
    kernel = checked(options.file, text)
    options.file.write_text(text, encoding="utf-8")
    count = len(kernel.axes)
    axes = "1 axis" if count == 1 else f"{count} axes"
    print(f"{options.file}: {axes}, {kernel.cycle_time * 1e3:g} ms")
    if "external" in words["drive"]:
        print("next: a loop of your own (`load`, `MotionKernel.step`); or, for drives on EtherCAT,")
        print("`sjerk ethercat describe IF` prints [ethercat] and [axes.ethercat] to be put in")
        return 0
    print(f"next: sjerk kernel {options.file}")
    print("then, in another terminal: sjerk enable && sjerk move 0=1 && sjerk status")
    return 0


# ---- answers


def _answers(options: argparse.Namespace, asks: bool) -> dict[str, list[str]]:
    """Words by question; raises InputError naming the options that are missing."""
    words: dict[str, list[str]] = {}
    missing = []
    for question in _QUESTIONS:
        given = getattr(options, question.name)
        default = question.default
        if question.name == "per_turn" and _TURN.keys() >= set(words["unit"]):
            default = " ".join(repr(_TURN[unit]) for unit in words["unit"])  # each its own
        if given is None and asks:
            axes = len(words["names"]) if "names" in words else None
            given = _asked(question, default, axes)
        if given is None and default is not None:
            given = default.split()
        if given is None:
            missing.append(f"--{question.name.replace('_', '-')}")
            continue
        words[question.name] = [word.strip() for word in given]
    if missing:
        raise SjerkError(f"{' '.join(missing)}: needed, since here nothing can be asked; {_WHOLE}")
    return words


def _asked(question: Question, default: str | None, axes: int | None) -> list[str] | None:
    """One line of words; asked again until each of them can be used. None: the default.

    ``axes``: so many words, or one; None: at least one.
    """
    shown = f" [{default}]" if default is not None else ""
    while True:
        try:
            line = input(f"{question.text}{shown}: ").split()
        except EOFError:
            raise KeyboardInterrupt from None  # Ctrl-D ends the questions, and nothing is written
        if not line and default is not None:
            return None
        try:
            read = [question.kind(word) for word in line]
            if read and (axes is None or len(read) in (1, axes)):
                return line
        except ValueError:
            pass
        print(_HELP[question.kind], file=sys.stderr)


# ---- the file


def description(words: dict[str, list[str]], *, cycle_time: float, priority: int = 0) -> str:
    """The text of the file, one ``[[axes]]`` per name; raises InputError.

    ``words``: by question, one for all axes or one for each; ``names`` says how many there are.
    """
    names = words["names"]
    lines = [
        "# Written by `sjerk new`; fields: those of Axis, Limits, DriveConfig, Clock, Reactions.",
        f"cycle_time = {cycle_time!r} # s",
        "",
    ]
    if priority:
        lines += ["[clock]", f"priority = {priority} # of SCHED_FIFO", "lock_memory = true", ""]
    lines += ["[reactions]", 'host_death = "halt"']
    for i, name in enumerate(names):
        own = {key: _own(key, given, i, len(names)) for key, given in words.items()}
        lines += ["", "[[axes]]", f"name = {_quoted(name)}", *_axis(own)]
    return "\n".join(lines) + "\n"


def _own(key: str, given: list[str], i: int, axes: int) -> str:
    if len(given) not in (1, axes):
        raise InputError(key, " ".join(given), f"needs one value, or one for each of {axes} axes")
    word = given[0] if len(given) == 1 else given[i]
    if not word.isprintable():
        raise InputError(key, word, "must be printable, in one line")
    return word


def _axis(own: dict[str, str]) -> list[str]:
    unit, drive = own["unit"], own["drive"]
    if drive not in _DRIVES:
        raise InputError("drive", drive, f"must be one of {', '.join(_DRIVES)}")
    counts = _number("increments", own["increments"]) / _number("per_turn", own["per_turn"])
    rates = " ".join(
        f"{name} = {_number(name, own[name])!r}," for name in ("velocity", "acceleration", "jerk")
    ).rstrip(",")
    low, high = own["low"], own["high"]
    if (low == "-") != (high == "-"):
        raise InputError("low, high", f"{low}, {high}", "a range needs both of its ends")
    position = ""
    if low != "-":
        position = f", position = [{_number('low', low)!r}, {_number('high', high)!r}]"
    return [
        f"unit = {_quoted(unit)}",
        f"counts_per_unit = {counts!r} # increments of the motor's encoder, before the gear",
        f"gear = {_number('gear', own['gear'])!r}",
        f"limits = {{ {rates}{position} }} # {unit}/s, {unit}/s^2, {unit}/s^3",
        *([] if drive == "simulated" else [f"drive = {_quoted(drive)}"]),
    ]


def _number(name: str, word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise InputError(name, word, "must be a number") from None
    if not math.isfinite(value) or (value <= 0.0 and name not in ("low", "high")):
        raise InputError(name, word, "must be finite, and greater than 0")
    return value


def _quoted(text: str) -> str:
    r"""A basic string of TOML.

    >>> _quoted('a"b')
    '"a\\"b"'
    """
    return json.dumps(text, ensure_ascii=False)


def checked(path: Path, text: str) -> MotionKernel:
    """The kernel that the text describes, not started; raises ConfigError with the place."""
    return described(path, tomllib.loads(text), name=f"new-{os.getpid()}")
