"""The joints of an executor: their names, the axis of each, and texts that call them so.

Never here: goals, motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sjerk.cycle.states import AxisState
from sjerk.errors import InputError, MotionStoppedError, RefusedError, SjerkError
from sjerk.host import Feedback, Host, PathFeedback
from sjerk.host.arguments import joint_axes

_UNABLE = (AxisState.DISABLED, AxisState.ERROR_STOP, AxisState.STOPPING, AxisState.HOMING)


@dataclass(frozen=True)
class Joints:
    """Names of joints, and the axis number of each."""

    names: tuple[str, ...]
    axes: tuple[int, ...]

    @classmethod
    def of(cls, host: Host, names: Sequence[str] | None, axes: Sequence[int] | None) -> Joints:
        """As ``TrajectoryExecutor`` takes them; raises InputError."""
        chosen = joint_axes(axes, host.axis_count)
        if names is None:
            names = [host.names[i] for i in chosen]
            for i, name in zip(chosen, names, strict=True):
                if not name:
                    why = f"axis {i} has no name: give one per axis, or Axis(name=...)"
                    raise InputError("joint_names", None, why)
        if isinstance(names, str) or not all(isinstance(name, str) for name in names):
            raise InputError("joint_names", names, "must be a list of one str per axis")
        if len(names) != len(chosen) or len(set(names)) != len(chosen):
            why = f"must be {len(chosen)} different names"
            raise InputError("joint_names", list(names), why)
        return cls(tuple(names), tuple(chosen))

    def axis(self, name: str) -> int:
        """The axis of a joint."""
        return self.axes[self.names.index(name)]

    def name(self, axis: int) -> str:
        """The joint of an axis."""
        return self.names[self.axes.index(axis)]

    def label(self, axis: int) -> str:
        """How texts call an axis."""
        return f"joint {self.name(axis)}" if axis in self.axes else f"axis {axis}"

    def told(self, error: SjerkError) -> str:
        """The text of an error, with joints for axes."""
        if isinstance(error, RefusedError | MotionStoppedError):
            return error.told(self.label)
        return str(error)

    def idle(self, host: Host, frame: Feedback, names: Sequence[str]) -> list[str]:
        """Which of these joints cannot move now, or are to be disabled."""
        orders = host.link.command.axis
        axes = {name: self.axis(name) for name in names}
        return [
            name
            for name, i in axes.items()
            if not frame.axes[i].follows or frame.axes[i].state in _UNABLE or not orders[i].enable
        ]

    def busy(self, path: PathFeedback, axes: Sequence[int]) -> str:
        """What a path of another hand in play means for one of these axes: nothing, or a refusal.

        Where it has one of the axes they are waited for, as for any motion.
        """
        if not set(path.axes).isdisjoint(axes):
            return ""
        whose = ", ".join(map(self.label, path.axes))
        return (
            f"a kernel plays one path at a time, and path {path.goal_id} of {whose} is in play: "
            "send the goal when that is over, or give all joints to one executor"
        )
