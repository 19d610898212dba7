"""``sjerk simulate``: a recording once more, compared bit for bit. Never here: motion."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sjerk.cli.common import add_verb, show
from sjerk.recording import replay


def add_arguments(jobs: Any) -> None:
    """Add simulate."""
    text = "run a recording again and compare every bit"
    job = add_verb(jobs, "simulate", run, text, named=False)
    job.add_argument("file", type=Path, help="a recording, .parquet or .mcap")


def run(options: argparse.Namespace) -> int:
    """Exit code 1 where the recording does not come out again."""
    done = replay(options.file)
    show(
        options,
        {
            "cycles": done.cycles,
            "identical": done.identical,
            "difference": None if done.difference is None else str(done.difference),
            "times_real_time": round(done.speed, 1),
        },
    )
    return 0 if done.identical else 1
