"""The order of the rooms, held against the C: who includes what, and who calls what.

    python tools/rooms.py [--graph] [CHECKOUT]

Rooms are the folders of ``src/sjerk`` and the C files beside them. Their order, top down, is that
of the layers in pyproject.toml, which import-linter holds against the Python; peers in one layer
(``a | b``) do not know each other, nor do the folders of ``ports``. A file may include and call
what lies below, and what its own room has, if nothing in the room comes back to it. Calls are read
from the objects: a symbol that one file needs and another defines. Each violation is one line with
the files, what is included or called, and the rooms; the exit code is 1 if there are any.

The C of a cycle has no heap, no statics, no I/O and no clock: outside the rooms that may (``MAY``)
a file needs nothing of the system but the names in ``PURE``, and defines no data that changes.
"""

from __future__ import annotations

import argparse
import itertools
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

#: The room whose folders are rooms of their own, without knowledge of each other.
PORTS = "ports"
#: Rooms whose C speaks with the system: the clock of the process, and sockets.
MAY = ("kernel", PORTS)
#: What other C may need of the system: functions of their arguments, and the processor's kind.
PURE = frozenset(
    [
        "memcpy",
        "memset",
        "memmove",
        "memcmp",
        "cbrt",
        "ceil",
        "copysign",
        "expm1",
        "fabs",
        "floor",
        "fma",
        "fmax",
        "fmin",
        "hypot",
        "llround",
        "pow",
        "sqrt",
        "trunc",
        "__cpu_model",
        "__cpu_indicator_init",
    ]
)
_INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)


class Use(NamedTuple):
    """``file`` includes or calls ``what``, which is, or is defined in, ``other``."""

    file: str
    other: str
    what: str


# ---- what is declared ----------------------------------------------------------------------------


def floors(settings: Mapping[str, Any]) -> dict[str, int]:
    """Floor of each room, 0 at the top, from the settings in pyproject.toml."""
    found: dict[str, int] = {}
    for contract in settings["tool"]["importlinter"]["contracts"]:
        if contract["type"] != "layers" or contract["containers"] != ["sjerk"]:
            continue
        for floor, layer in enumerate(contract["layers"]):
            for room in re.split(r"[|:]", layer):
                found[room.strip(" ()")] = floor
    return found


def room_of(file: str) -> str:
    """The room of a file, by its path from ``src/sjerk``."""
    parts = PurePosixPath(file).parts
    if parts[0] == PORTS and len(parts) > 2:
        return "/".join(parts[:2])
    return parts[0] if len(parts) > 1 else PurePosixPath(file).stem


# ---- what is there -------------------------------------------------------------------------------


class Symbols(NamedTuple):
    """Of one object: names that it needs, those it defines, and data of its own that may change."""

    needed: set[str]
    own: set[str]
    data: set[str]


def includes(root: Path) -> Iterator[Use]:
    """Every ``#include "..."`` of a file of the house."""
    for file in sorted(root.rglob("*.[ch]")):
        name = file.relative_to(root).as_posix()
        for what in _INCLUDE.findall(file.read_text()):
            beside, below = file.parent / what, root / what
            other = beside if beside.exists() else below
            yield Use(name, os.path.relpath(other, root).replace(os.sep, "/"), f'"{what}"')


def objects(root: Path) -> dict[str, Symbols]:
    """What each C file of the house needs and defines."""
    files = sorted(root.rglob("*.c"))
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:

        def symbols(numbered: tuple[int, Path]) -> Symbols:
            number, source = numbered
            out = Path(folder) / f"{number}.o"
            compiler = os.environ.get("CC", "cc")
            # not optimised: nothing is inlined, and what is called stays a call; not to be moved:
            # a constant table of addresses is then no data that changes
            flags = ["-std=c11", "-O0", "-fno-pic", "-fno-pie", "-w", f"-I{root}"]
            flags += ["-c", str(source), "-o", str(out)]
            subprocess.run([compiler, *flags], check=True)
            table = subprocess.run(["nm", "-P", out], check=True, capture_output=True, text=True)
            rows = [line.split()[:2] for line in table.stdout.splitlines()]
            needed = {name for name, kind in rows if kind == "U"}
            own = {name for name, kind in rows if kind in "TDBRVW"}
            return Symbols(needed, own, {name for name, kind in rows if kind in "dDbBC"})

        tables = list(pool.map(symbols, enumerate(files)))
    return {
        file.relative_to(root).as_posix(): table for file, table in zip(files, tables, strict=True)
    }


def calls(tables: Mapping[str, Symbols]) -> Iterator[Use]:
    """Every symbol that one file of the house needs and another one defines."""
    owner = {name: file for file, table in tables.items() for name in table.own}
    for file, table in tables.items():
        for name in sorted(table.needed & owner.keys()):
            yield Use(file, owner[name], name)


# ---- what is wrong -------------------------------------------------------------------------------


def upward(uses: Iterable[Use], floor: Mapping[str, int], verb: str) -> Iterator[str]:
    """Uses of what does not lie below, between rooms."""
    for use in uses:
        here, there = room_of(use.file), room_of(use.other)
        if here == there:
            continue
        unknown = [room for room in (here, there) if room.partition("/")[0] not in floor]
        if unknown:
            yield f"{use.file} {verb} {use.what} of {use.other}: no floor for {unknown[0]}"
            continue
        rise = floor[here.partition("/")[0]] - floor[there.partition("/")[0]]
        if rise >= 0:
            what = "upward" if rise else "between peers"
            yield f"{use.file} {verb} {use.what} of {use.other}: {what}, {here} -> {there}"


def impure(tables: Mapping[str, Symbols]) -> Iterator[str]:
    """What a cycle may not have: the system behind a function, and data that outlives a call."""
    house = set().union(*(table.own for table in tables.values()))
    for file, table in tables.items():
        if room_of(file).partition("/")[0] in MAY:
            continue
        for name in sorted(table.needed - house - PURE):
            yield f"{file} needs {name} of the system: only {', '.join(MAY)} may"
        for name in sorted(table.data):
            yield f"{file} has data that changes, {name}: pass state in"


def circles(uses: Iterable[Use]) -> Iterator[str]:
    """Files of one room that come back to themselves, by calls or by includes of headers."""
    arrows: dict[str, dict[str, str]] = {}
    for use in uses:
        if use.file != use.other and room_of(use.file) == room_of(use.other):
            arrows.setdefault(use.file, {}).setdefault(use.other, use.what)
    for group in _components(arrows):
        way = _circle(arrows, group)
        steps = [f"{a} -> {b} ({arrows[a][b]})" for a, b in itertools.pairwise(way)]
        yield f"circle of {len(group)} files in {room_of(way[0])}: {', '.join(steps)}"


def _reached(arrows: Mapping[str, Iterable[str]], start: str) -> set[str]:
    found: set[str] = set()
    left = [start]
    while left:
        for other in arrows.get(left.pop(), ()):
            if other not in found:
                found.add(other)
                left.append(other)
    return found


def _components(arrows: Mapping[str, Mapping[str, str]]) -> Iterator[set[str]]:
    """Groups of more than one file that all reach each other."""
    reached = {file: _reached(arrows, file) for file in arrows}
    seen: set[str] = set()
    for file in sorted(arrows):
        group = {other for other in reached[file] if file in reached.get(other, ())}
        if group and file not in seen:
            seen |= group
            yield group


def _circle(arrows: Mapping[str, Mapping[str, str]], group: set[str]) -> list[str]:
    """A shortest way from a file of the group back to it."""
    start = min(group)
    ways = [[start]]
    while True:
        longer = []
        for way in ways:
            for other in sorted(arrows[way[-1]]):
                if other == start:
                    return [*way, other]
                if other in group and other not in way:
                    longer.append([*way, other])
        ways = longer


def violations(checkout: Path) -> tuple[list[str], list[Use]]:
    """What is wrong, and all uses between files."""
    root = checkout / "src" / "sjerk"
    floor = floors(tomllib.loads((checkout / "pyproject.toml").read_text()))
    tables = objects(root)
    included, called = list(includes(root)), list(calls(tables))
    wrong = [*upward(included, floor, "includes"), *upward(called, floor, "calls")]
    wrong += impure(tables)
    wrong += circles([*included, *called])
    return wrong, [*included, *called]


def main() -> int:
    """1 where the order is not kept."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    here = Path(__file__).resolve().parent.parent
    parser.add_argument("checkout", nargs="?", type=Path, default=here)
    parser.add_argument("--graph", action="store_true", help="print who knows whom, by rooms")
    given = parser.parse_args()
    wrong, uses = violations(given.checkout)
    if given.graph:
        rooms = {(room_of(use.file), room_of(use.other)) for use in uses}
        for one in sorted({one for one, _ in rooms}):
            print(f"{one}: {', '.join(sorted(two for o, two in rooms if o == one and two != one))}")
    for line in wrong:
        print(line)
    print(f"rooms: {len(wrong)} violations in {len(uses)} includes and calls")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
