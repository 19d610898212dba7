"""Joints of ROS and axes of a kernel: whose name is which, and whose unit is how long.

ROS has radians and metres; an axis has the unit of its kernel. Never here: messages, motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sjerk.errors import InputError
from sjerk.profile import FloatArray
from sjerk.trajectory import Trajectory

#: Axis units in one radian or metre; an axis without a unit is taken to be in these.
UNITS: Mapping[str, float] = {
    "": 1.0,
    "rad": 1.0,
    "deg": 180.0 / math.pi,
    "rev": 0.5 / math.pi,
    "m": 1.0,
    "mm": 1000.0,
}


@dataclass(frozen=True, eq=False)
class Joints:
    """The joints of a kernel: ``names``, one per axis in order, and ``scale`` (N,).

    ``scale``: axis units in one radian or metre.

    >>> arm = Joints.of(["turn", "lift"], ["deg", "mm"])
    >>> arm.to_axes([np.pi, 0.5]).tolist()
    [180.0, 500.0]
    >>> arm.to_ros([90.0, 20.0]).round(4).tolist()
    [1.5708, 0.02]
    """

    names: tuple[str, ...]
    scale: FloatArray

    @classmethod
    def of(cls, names: Sequence[str], units: Sequence[str]) -> Joints:
        """One name per axis, and the axes' units; raises InputError."""
        if isinstance(names, str) or not all(isinstance(name, str) and name for name in names):
            raise InputError("joints", names, "must be a list of one name per axis")
        if len(names) != len(units):
            raise InputError("joints", list(names), f"must be {len(units)}: one per axis")
        for name in names:
            if list(names).count(name) > 1:
                raise InputError("joints", list(names), f"{name!r} is there twice")
        for name, unit in zip(names, units, strict=True):
            if unit not in UNITS:
                known = ", ".join(repr(unit) for unit in UNITS)
                raise InputError(f"unit of joint {name!r}", unit, f"must be one of {known}")
        return cls(tuple(names), np.array([UNITS[unit] for unit in units]))

    def scale_of(self, name: str) -> float:
        """Axis units in one radian or metre of this joint; 1 for one that is not here."""
        return float(self.scale[self.names.index(name)]) if name in self.names else 1.0

    def to_axes(self, values: ArrayLike) -> FloatArray:
        """Radians and metres (..., N) in axis units."""
        return np.asarray(values, dtype=np.float64) * self.scale

    def to_ros(self, values: ArrayLike) -> FloatArray:
        """Axis units (..., N) in radians and metres."""
        return np.asarray(values, dtype=np.float64) / self.scale

    def trajectory(self, way: Trajectory) -> Trajectory:
        """A trajectory in radians and metres, of any of the joints in any order, in axis units."""
        scale = np.array([self.scale_of(name) for name in way.joint_names])
        with np.errstate(over="ignore"):  # what is too large to be scaled is refused: not finite
            return Trajectory(
                way.joint_names,
                way.time,
                way.position * scale,
                None if way.velocity is None else way.velocity * scale,
                None if way.acceleration is None else way.acceleration * scale,
            )

    def row(self, names: Sequence[str], values: Sequence[float], field: str) -> FloatArray:
        """One value per axis (N,), in axis units, from a message that names joints in any order.

        The message may name other joints besides. Raises InputError where a joint is not there, is
        there twice, has no value, or one that is no finite number.
        """
        if len(values) != len(names):
            raise InputError(field, len(values), f"must be one per name: {len(names)}")
        found = np.empty(len(self.names))
        for k, joint in enumerate(self.names):
            places = [i for i, name in enumerate(names) if name == joint]
            if len(places) != 1:
                what = "is not named" if not places else f"is named {len(places)} times"
                raise InputError("name", list(names), f"joint {joint!r} {what}")
            value = float(values[places[0]])
            if not math.isfinite(value):
                raise InputError(f"{field} of joint {joint!r}", value, "must be finite")
            found[k] = value
        return self.to_axes(found)
