"""The robot that comes with sjerk, a kernel and a desk of it, for tests of the panel."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np

from helpers.panel_client import until
from helpers.root import SOURCES
from sjerk import Monitor, MotionKernel
from sjerk.kernel import load
from sjerk.ports.panel.desk import Desk
from sjerk.ports.panel.journal import Journal
from sjerk.ports.panel.lead import Lead
from sjerk.ports.panel.settings import PanelSettings
from sjerk.ports.panel.watching import Watching

PANDA = SOURCES / "data" / "panda.toml"
ROBOT = load(PANDA)
RANGES = np.array([axis.limits.position for axis in ROBOT.axes])
SETTINGS = PanelSettings.of(PANDA, tomllib.loads(PANDA.read_text()), 7, fixed=True)
#: The number of a browser.
ONE = 1


def ideal_kernel() -> MotionKernel:
    """Seven axes whose motors are where they are commanded to be."""
    axes = [replace(axis, drive="ideal", following_error=None) for axis in ROBOT.axes]
    return MotionKernel(axes, 1e-3)


class Bench:
    """A kernel with seven ideal axes, and a desk at it."""

    def __init__(self, kernel: MotionKernel, folder: Path) -> None:
        self.kernel = kernel
        self.monitor = Monitor.attach(kernel.name)
        self.watching = Watching(kernel.name, axes=7)
        feedback = until(self.watching.attach, "a kernel")
        self.journal = Journal()
        self.lead = Lead(self.watching, self.journal.tell)
        self.desk = Desk(SETTINGS, self.watching, self.lead, self.journal, feedback, folder=folder)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.desk.close()
        self.rests()
        self.watching.close()
        self.monitor.close()

    def ready(self) -> Desk:
        """Browser one leads, and the drives follow."""
        self.lead.take(ONE)
        self.lead.of(ONE).enable()
        return self.desk

    @property
    def moves(self) -> bool:
        """Whether any axis moves."""
        return self.monitor.feedback().moving

    def rests(self) -> None:
        """Wait until no axis moves."""
        until(lambda: not self.moves, "at rest")
