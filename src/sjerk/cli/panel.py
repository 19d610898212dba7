"""``sjerk panel``: a page in a browser on a running kernel. Never here: pages, kernels."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sjerk.cli.arguments import ENDLESS, duration_or_inf
from sjerk.cli.common import add_verb, show, sigterm_as_ctrl_c
from sjerk.errors import InputError
from sjerk.extras import load


def add_arguments(jobs: Any) -> None:
    """Add panel."""
    text = "see, plan, execute, jog and stop in a browser (extra: panel)"
    job = add_verb(jobs, "panel", run, text)
    job.add_argument(
        "robot", nargs="?", type=Path, help="TOML of a kernel with [panel]; default: a Panda"
    )
    job.add_argument("--port", type=int, default=8200, help="of 127.0.0.1; the next one if taken")
    job.add_argument(
        "--urdf", type=Path, help="the arm: joints by the names of the axes, or in their order"
    )
    job.add_argument("--tip", metavar="LINK", help="of the URDF: the link that is the flange")
    job.add_argument("--no-lead", action="store_true", help="no link that leads, only one to view")
    job.add_argument("--open", action="store_true", help="open the browser of this machine")
    job.add_argument("--seconds", type=duration_or_inf, default=float("inf"), help=ENDLESS)


def run(options: argparse.Namespace) -> int:
    """Exit code 0 after Ctrl-C: the page is closed, and what it moved is at rest."""
    if options.robot is not None and not options.robot.is_file():
        raise InputError("robot", str(options.robot), "is no file")
    if options.urdf is not None and not options.urdf.is_file():
        raise InputError("urdf", str(options.urdf), "is no file")
    if options.tip is not None and options.urdf is None:
        raise InputError("tip", options.tip, "is a link of --urdf FILE")
    if not 0 <= options.port <= 65535:
        raise InputError("port", options.port, "must be 0 .. 65535")
    panel = load("sjerk.ports.panel.main", extra="panel")
    order = panel.Order(
        robot=options.robot,
        name=options.name,
        port=options.port,
        lead=not options.no_lead,
        open=options.open,
        any_owner=options.any_owner,
        seconds=options.seconds,
        urdf=options.urdf,
        tip=options.tip,
    )
    with sigterm_as_ctrl_c():
        return int(panel.run(order, lambda links: show(options, links)))
