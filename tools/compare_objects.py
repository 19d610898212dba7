"""The machine code of two checkouts, compared object by object.

    python tools/compare_objects.py OLD NEW [--map FILE] [--flags=...]

Every ``src/sjerk/**/_*.c`` is built with the flags of the extension, without link-time
optimisation. An object is *identical* where all sections, relocations and symbols are the same,
names included; *renamed* where only names of symbols are other ones. Objects are matched by
``--map`` (lines ``old new``, paths from ``src/sjerk``), else by content, else by what they define.
The exit code is 1 where an object has other code, or has no partner.
"""

from __future__ import annotations

import argparse
import itertools
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

FLAGS = (
    "-std=c11 -O3 -ffp-contract=off -fno-trapping-math -fno-math-errno"
    " -fvisibility=hidden -fPIC -fno-lto"
)
#: Sections that tell of the compiler or the file, not of the code.
_ABOUT = re.compile(r"\.(comment|note|debug|strtab|shstrtab|symtab)")
_RELOCATION = re.compile(r"^([0-9a-f]{8,}) (\S+) +(\S+?)((?:[+-]0x[0-9a-f]+)?)$")
_SYMBOL = re.compile(r"^[0-9a-f]{8,} .{7} (\S+)\s+[0-9a-f]+ (?:\.hidden )?(\S+)$")


@dataclass(frozen=True)
class Object:
    """What ``objdump`` says: ``lines`` as they are, ``anonymous`` with numbers for names."""

    lines: tuple[str, ...]
    anonymous: tuple[str, ...]
    defines: frozenset[str]


# ---- building ------------------------------------------------------------------------------------


def build(checkout: Path, flags: str) -> dict[str, Object]:
    """All objects, by their path from ``src/sjerk``."""
    root = checkout / "src" / "sjerk"
    sources = sorted(root.rglob("_*.c"))
    compiler = os.environ.get("CC", "cc")
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:

        def one(source: Path) -> Object:
            out = Path(folder) / (str(source.relative_to(root)).replace("/", "-") + ".o")
            command = [compiler, *flags.split(), f"-I{root}", "-c", str(source), "-o", str(out)]
            subprocess.run(command, check=True)
            return read(out)

        names = [str(source.relative_to(root)) for source in sources]
        return dict(zip(names, pool.map(one, sources), strict=True))


def read(path: Path) -> Object:
    """Contents and relocations of all sections but those about the file, and its symbols."""
    text = subprocess.run(
        ["objdump", "-s", "-r", "-t", "-w", str(path)], check=True, capture_output=True, text=True
    ).stdout
    lines: list[str] = []
    symbols: list[str] = []
    defines: set[str] = set()
    section = ""
    for line in text.splitlines()[2:]:  # above them: the file's name
        heading = re.match(r"(?:Contents of section|RELOCATION RECORDS FOR) \[?([^\]:]+)", line)
        section = heading[1] if heading else section
        found = _SYMBOL.match(line)
        if found:
            if found[1] != "*ABS*":  # else: the name of the source file
                symbols.append(line)
                if found[1] != "*UND*" and not found[2].startswith("."):
                    defines.add(found[2])
        elif line and not _ABOUT.match(section):
            lines.append(line)
    return Object((*lines, *sorted(symbols)), tuple(_anonymous(lines)), frozenset(defines))


def _anonymous(lines: list[str]) -> list[str]:
    """Names in relocations by the order in which they come, but those of sections."""
    numbers: dict[str, str] = {}
    found = []
    for line in lines:
        relocation = _RELOCATION.match(line)
        if relocation is None:
            found.append(line)
            continue
        at, kind, name, offset = relocation.groups()
        if not name.startswith("."):
            name = numbers.setdefault(name, f"symbol {len(numbers)}")
        found.append(f"{at} {kind} {name}{offset}")
    return found


# ---- matching ------------------------------------------------------------------------------------


def match(
    old: Mapping[str, Object], new: Mapping[str, Object], given: Mapping[str, str]
) -> dict[str, str]:
    """Old path -> new path, each at most once."""
    pairs = {a: b for a, b in given.items() if a in old and b in new}

    def left() -> tuple[list[str], list[str]]:
        return [a for a in old if a not in pairs], [b for b in new if b not in pairs.values()]

    for key in ("lines", "anonymous"):
        ours, theirs = left()
        known = {getattr(new[b], key): b for b in reversed(theirs)}
        for a in ours:
            b = known.pop(getattr(old[a], key), None)
            if b is not None:
                pairs[a] = b
    ours, theirs = left()
    shared = [
        (len(old[a].defines & new[b].defines), a == b, a, b)
        for a, b in itertools.product(ours, theirs)
    ]
    for count, _, a, b in sorted(shared, reverse=True):
        if count and a not in pairs and b not in pairs.values():
            pairs[a] = b
    return pairs


def main() -> int:
    """0 where all code is the same."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--map", type=Path, help="lines 'old new'")
    parser.add_argument("--flags", default=FLAGS)
    given = parser.parse_args()
    old, new = build(given.old, given.flags), build(given.new, given.flags)
    rows = [line.split() for line in given.map.read_text().splitlines()] if given.map else []
    pairs = match(old, new, {row[0]: row[1] for row in rows if len(row) == 2})
    counts = dict.fromkeys(("identical", "renamed", "other code", "only OLD", "only NEW"), 0)
    for a in sorted(old):
        if a not in pairs:
            verdict, b = "only OLD", ""
        else:
            b = pairs[a]
            same, alike = old[a].lines == new[b].lines, old[a].anonymous == new[b].anonymous
            verdict = "identical" if same else "renamed" if alike else "other code"
        counts[verdict] += 1
        print(f"{verdict:10s} {a}{' -> ' + b if b not in ('', a) else ''}")
    for b in sorted(new.keys() - pairs.values()):
        counts["only NEW"] += 1
        print(f"{'only NEW':10s} {b}")
    print(", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count))
    return 0 if counts["identical"] + counts["renamed"] == len(old) == len(new) else 1


if __name__ == "__main__":
    sys.exit(main())
