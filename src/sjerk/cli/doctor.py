"""``sjerk doctor``: what this machine grants a kernel, with the lines that mend it.

Never here: how it is tried (``machine.py``).
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import Any

from sjerk.cli.arguments import duration
from sjerk.cli.machine import Verdict, findings
from sjerk.cli.version import text


def add_arguments(jobs: Any) -> None:
    """Add doctor."""
    job = jobs.add_parser("doctor", help="what this machine grants, and the lines that mend it")
    job.add_argument(
        "--seconds", type=duration, default=2.0, help="how long a kernel is tried (default: 2)"
    )
    job.add_argument("--json", action="store_true", help="one JSON object per finding")
    job.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Exit code 1 where no kernel can run, else 0."""
    if not options.json:
        print(text())
    can_run = True
    for finding in findings(options.seconds):
        can_run &= finding.verdict is not Verdict.NEEDED
        if options.json:
            print(json.dumps(asdict(finding)), flush=True)
            continue
        mark = {Verdict.GRANTED: "ok", Verdict.REFUSED: "--", Verdict.NEEDED: "!!"}
        print(f"{mark[finding.verdict]}  {finding.of}: {finding.found}", flush=True)
        if finding.mend:
            print(f"      {finding.mend}", flush=True)
    return 0 if can_run else 1
