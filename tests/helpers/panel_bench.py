"""The robot that comes with sjerk, for tests of the panel."""

from __future__ import annotations

import tomllib

import numpy as np

from helpers.root import SOURCES
from sjerk.kernel import load
from sjerk.ports.panel.settings import PanelSettings

PANDA = SOURCES / "data" / "panda.toml"
ROBOT = load(PANDA)
RANGES = np.array([axis.limits.position for axis in ROBOT.axes])
SETTINGS = PanelSettings.of(PANDA, tomllib.loads(PANDA.read_text()), 7, fixed=True)
