"""The motion of two checkouts, compared over random scripts in virtual time.

    python tools/same_motion OLD NEW --seeds 1500 [--first 0] [--families moves paths ...]

Each checkout runs the same scripts in its own ``.venv``. Motion (every recorded column of every
cycle) must be equal bit for bit, else the exit code is 1. Events, and what a host is told, are
compared too: differences are listed by kind. Two processes at a time; no thread, no wall clock.
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

FAMILIES = ("moves", "paths", "streams", "executor", "homing", "faults", "planner", "drive")
SHOWN = 8  # kinds of differences that are listed per family

Told = dict[str, Any]


class Verdict(NamedTuple):
    """Of one family: seeds, those of equal motion and of equal events, first of the others."""

    seeds: int
    motion: int
    events: int
    moved: int | None
    told: int | None
    kinds: Counter[str]
    alone: set[str]


# ---- running -------------------------------------------------------------------------------------


def _start(checkout: Path, family: str, first: int, last: int, *more: str) -> subprocess.Popen[str]:
    python = checkout / ".venv" / "bin" / "python"
    if not python.exists():
        sys.exit(f"{python} is missing: './run test --collect-only' in that checkout makes it")
    worker = Path(__file__).with_name("worker.py")
    given = [family, str(first), str(last), "--checkout", str(checkout), *more]
    return subprocess.Popen([python, worker, *given], stdout=subprocess.PIPE, text=True)


def _pairs(old: Path, new: Path, family: str, first: int, last: int) -> Iterator[tuple[Told, Told]]:
    """What both told of each seed, in step."""
    runs = [_start(checkout, family, first, last) for checkout in (old, new)]
    try:
        for lines in zip(*(run.stdout or () for run in runs), strict=False):
            before, after = map(json.loads, lines)
            yield before, after
        for checkout, run in zip((old, new), runs, strict=True):
            if run.wait():
                sys.exit(f"{checkout}: the worker failed, the lines above say why")
    finally:
        for run in runs:
            run.kill()
            run.wait()


def _whole(checkout: Path, family: str, seed: int) -> Told:
    run = _start(checkout, family, seed, seed + 1, "--whole")
    found: Told = json.loads(run.communicate()[0])
    return found


# ---- comparing -----------------------------------------------------------------------------------


def _moved(old: Told, new: Told) -> bool:
    common = old["motion"].keys() & new["motion"].keys()
    return not common or any(old["motion"][name] != new["motion"][name] for name in common)


def _kinds(old: list[str], new: list[str]) -> Counter[str]:
    """How two lists of events differ: what only one has, or the order of those that both have."""
    found: Counter[str] = Counter()
    gone, come = Counter(old) - Counter(new), Counter(new) - Counter(old)
    for name, part in (("only OLD", gone), ("only NEW", come)):
        for event, count in part.items():
            found[f"{event.split()[0]}: {name}"] += count
    both = Counter(old) & Counter(new)
    orders = [_kept(events, Counter(both)) for events in (old, new)]
    for one, two in zip(*orders, strict=True):
        if one != two:
            found[f"order: {one.split()[0]} / {two.split()[0]}"] += 1
    return found


def _kept(events: list[str], both: Counter[str]) -> list[str]:
    kept = []
    for event in events:
        if both[event] > 0:
            both[event] -= 1
            kept.append(event)
    return kept


def compare(old: Path, new: Path, family: str, first: int, last: int) -> Verdict:
    """All seeds of a family."""
    seeds = motion = events = 0
    moved = told = None
    kinds: Counter[str] = Counter()
    alone: set[str] = set()
    for before, after in _pairs(old, new, family, first, last):
        seeds += 1
        alone |= before["motion"].keys() ^ after["motion"].keys()
        if not _moved(before, after):
            motion += 1
        elif moved is None:
            moved = before["seed"]
        if before["events"] == after["events"]:
            events += 1
        else:
            told = before["seed"] if told is None else told
            kinds.update(_kinds(before["events"], after["events"]))
        if seeds % 25 == 0:
            print(f"\r{family}: {seeds} of {last - first}", end="", file=sys.stderr, flush=True)
    print("\r" + " " * 40, end="\r", file=sys.stderr, flush=True)
    return Verdict(seeds, motion, events, moved, told, kinds, alone)


# ---- showing -------------------------------------------------------------------------------------


def _both(old: list[Any], new: list[Any], missing: Any = "none") -> list[tuple[Any, Any]]:
    return list(itertools.zip_longest(old, new, fillvalue=missing))


def _first_differences(old: Told, new: Told) -> list[str]:
    """The first row of each column that is not the same, the earliest first."""
    found = []
    for name in old["motion"].keys() & new["motion"].keys():
        for part, (one, two) in enumerate(_both(old["motion"][name], new["motion"][name], [])):
            if one != two:
                rows = enumerate(_both(one, two))
                row, (a, b) = next((i, pair) for i, pair in rows if pair[0] != pair[1])
                found.append((part, row, f"part {part} row {row} {name}: {a} -> {b}"))
                break
    return [text for *_, text in sorted(found)]


def _show(old: Path, new: Path, family: str, found: Verdict) -> None:
    print(f"{family:10s} {found.seeds:6d} {found.motion:8d} {found.events:8d}", flush=True)
    if found.alone:
        print(f"    columns of one checkout only, not compared: {', '.join(sorted(found.alone))}")
    if found.moved is not None:
        print(f"    motion differs first at seed {found.moved}, OLD -> NEW:")
        whole = [_whole(checkout, family, found.moved) for checkout in (old, new)]
        for line in _first_differences(*whole)[:SHOWN]:
            print(f"    {line}")
    if found.told is not None:
        print(f"    events differ first at seed {found.told}; how often which:")
        for kind, count in found.kinds.most_common(SHOWN):
            print(f"    {count:8d} {kind}")
        rows = [_whole(checkout, family, found.told)["events"] for checkout in (old, new)]
        one, two = next(pair for pair in _both(*rows) if pair[0] != pair[1])
        print(f"    OLD {one}\n    NEW {two}")


def main() -> int:
    """1 where motion differs."""
    parser = argparse.ArgumentParser(
        prog="same_motion", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--seeds", type=int, default=1500, help="how many, of each family")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=FAMILIES)
    given = parser.parse_args()
    old, new = given.old.resolve(), given.new.resolve()
    print(f"{'family':10s} {'seeds':>6s} {'motion =':>8s} {'events =':>8s}", flush=True)
    same = True
    for family in given.families:
        found = compare(old, new, family, given.first, given.first + given.seeds)
        _show(old, new, family, found)
        same &= found.moved is None and found.seeds == given.seeds
    print("motion is equal" if same else "motion differs")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
