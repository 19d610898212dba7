"""Inverse kinematics: angles that bring the flange to a pose, by damped least squares.

(Y. Nakamura, H. Hanafusa, 1986.) From the angles at hand, so the nearest way of many is likely to
be found. Never here: obstacles, motion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sjerk.errors import SjerkError
from sjerk.ports.panel.arm import Arm

FloatArray = NDArray[np.float64]

_STEPS, _TRIES = 200, 12
_DAMPING = 1e-4
_TURN_WEIGHT = 0.3  # metres per radian
_NEAR, _ALIGNED = 1e-6, 1e-5  # m, rad
_LARGEST = 0.3  # rad of one step


class UnreachableError(SjerkError):
    """No angles within the joints' ranges bring the flange there."""


def solve(
    arm: Arm, goal: ArrayLike, start: ArrayLike, lower: ArrayLike, upper: ArrayLike
) -> FloatArray:
    """Angles (N,) whose flange is at ``goal`` (4, 4), m, to 1 um and 10 urad.

    ``start`` (N,): where the search begins; where that fails, other places, the same ones each
    time. Raises UnreachableError.

    >>> elbow = Arm([[0.0, 0.3, 0.0], [0.0, 0.0, -np.pi / 2]], flange=0.2, radius=[0.05] * 3)
    >>> goal = elbow.tip([[0.4, 0.3]])[0]
    >>> solve(elbow, goal, [0.2, 0.1], [-1.0, -1.0], [1.0, 1.0]).round(4).tolist()
    [0.4, 0.3]
    """
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    pose, first = np.asarray(goal, float), np.clip(np.asarray(start, float), low, high)
    places = np.random.default_rng(0).uniform(low, high, (_TRIES - 1, arm.joints))
    for place in (first, *places):
        found = _search(arm, pose, place, low, high)
        if found is not None:
            return found
    x, y, z = pose[:3, 3]
    raise UnreachableError(f"the flange cannot be brought to ({x:.3f}, {y:.3f}, {z:.3f}) m so")


def _search(
    arm: Arm, goal: FloatArray, q: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray | None:
    for _ in range(_STEPS):
        frames = arm.frames(q)
        tip = arm.tip_of(frames)[0]
        error = np.concatenate([goal[:3, 3] - tip[:3, 3], _turn(goal[:3, :3] @ tip[:3, :3].T)])
        if np.abs(error[:3]).max() < _NEAR and np.abs(error[3:]).max() < _ALIGNED:
            return q
        axes, at = frames[0, 1:, :3, 2], frames[0, 1:, :3, 3]
        jacobian = np.concatenate([np.cross(axes, tip[:3, 3] - at), axes], axis=1).T
        jacobian[3:] *= _TURN_WEIGHT
        error[3:] *= _TURN_WEIGHT
        moved = _step(jacobian, error, q, low, high)
        if moved is None:
            return None
        q = moved
    return None


def _step(
    jacobian: FloatArray, error: FloatArray, q: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray | None:
    """One step; joints that would leave their range stay at its end, and the rest do without."""
    free = np.ones(len(q), bool)
    damping = _DAMPING * min(1.0, float(np.linalg.norm(error)))
    while free.any():
        step = np.zeros(len(q))
        own = jacobian[:, free]
        step[free] = own.T @ np.linalg.solve(own @ own.T + damping * np.eye(6), error)
        moved = q + np.clip(step, -_LARGEST, _LARGEST)
        stuck = free & ((moved < low) | (moved > high))
        if not stuck.any():
            return moved
        free &= ~stuck
    return None


def _turn(rotation: FloatArray) -> FloatArray:
    """Rotation vector of a rotation matrix, (3,), rad."""
    axis = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine, cosine = np.linalg.norm(axis) / 2.0, (np.trace(rotation) - 1.0) / 2.0
    if sine > 1e-9:
        found: FloatArray = axis / (2.0 * sine) * np.arctan2(sine, cosine)
        return found
    if cosine > 0.0:
        return axis / 2.0
    k = int(np.argmax(np.diag(rotation)))  # half a turn: about the axis with the largest entry
    column: FloatArray = rotation[:, k] + np.eye(3)[k]
    return np.pi * column / np.linalg.norm(column)
