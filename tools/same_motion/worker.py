"""Runs in one checkout: random scripts of one family, a line of JSON per seed.

    CHECKOUT/.venv/bin/python worker.py FAMILY FIRST LAST [--whole]

A line has a digest per column of motion, and the events; ``--whole`` gives the columns themselves.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import commanded
import planned
import sjerk
import streamed
import watched
from told import Told

FAMILIES: dict[str, Callable[[random.Random, Told], None]] = {
    "moves": commanded.moves,
    "paths": commanded.paths,
    "streams": streamed.streams,
    "executor": streamed.executor,
    "homing": watched.homing,
    "faults": watched.faults,
    "planner": planned.planner,
    "drive": planned.drive,
}


def _digest(column: list[np.ndarray]) -> str:
    found = hashlib.sha256()
    for part in column:
        found.update(str(part.shape).encode())
        found.update(np.ascontiguousarray(part).tobytes())
    return found.hexdigest()[:16]


def _plain(column: list[np.ndarray]) -> list[Any]:
    """Row by row; a float as its exact text, so that also the sign of zero and nan are told."""
    return [[str(row.tolist()) for row in part] for part in column]


def main() -> None:
    """One line per seed, in order."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("family", choices=FAMILIES)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--whole", action="store_true")
    parser.add_argument("--checkout", type=Path)
    given = parser.parse_args()
    here = Path(sjerk.__file__).resolve()
    if given.checkout is not None and given.checkout.resolve() not in here.parents:
        sys.exit(f"the environment of {given.checkout} has the sjerk of {here.parent}")
    for seed in range(given.first, given.last):
        told = Told()
        try:
            FAMILIES[given.family](random.Random(f"{given.family} {seed}"), told)
        except Exception as error:
            error.add_note(f"family {given.family}, seed {seed}")
            raise
        treat = _plain if given.whole else _digest
        motion = {name: treat(column) for name, column in told.columns.items()}
        print(json.dumps({"seed": seed, "motion": motion, "events": told.events}), flush=True)


if __name__ == "__main__":
    main()
