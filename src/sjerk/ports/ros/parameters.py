"""The parameters of the nodes as data: name, default, range, what for; and as settings of goals.

Names are those of joint_trajectory_controller where it has them. Never here: ROS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sjerk.errors import InputError
from sjerk.executor import Settings, Tolerance
from sjerk.ports.ros.joints import Joints
from sjerk.trajectory import ExecutionMode

Value = bool | int | float | str | list[str]


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter: its type is that of its ``default``.

    ``low``, ``high``: the range of a number; ``choices``: of a text. ``fixed``: read only once the
    node has been made; others change at any time and hold from the next goal on.
    """

    name: str
    default: Value
    about: str
    low: float | None = None
    high: float = 1e9
    choices: tuple[str, ...] = ()
    fixed: bool = False

    def check(self, value: Any) -> None:
        """Refuse a value of another type or outside the range; raises InputError."""
        wanted = type(self.default)
        if wanted is list:
            texts = isinstance(value, Sequence) and not isinstance(value, str | bytes)
            if not texts or not all(isinstance(one, str) for one in value):
                raise InputError(self.name, value, "must be a list of str")
            return
        if value.__class__ is not wanted:
            raise InputError(self.name, value, f"must be a {wanted.__name__}")
        if self.choices and value not in self.choices:
            raise InputError(self.name, value, f"must be one of {', '.join(self.choices)}")
        number: Any = value
        if self.low is not None and not (math.isfinite(number) and self.low <= number <= self.high):
            raise InputError(self.name, value, f"must lie in {self.low:g} .. {self.high:g}")


_KERNEL = (
    Parameter(
        name="joints",
        default=[""],
        about="names of the joints, one per axis in order; default: those of the axes",
        fixed=True,
    ),
    Parameter(
        name="kernel.file", default="", about="TOML file of a kernel to run as a child", fixed=True
    ),
    Parameter(
        name="kernel.hardware",
        default="",
        about="drives of kernel.file: simulated, whatever bus it has, or ethercat; "
        "default: as it says",
        choices=("", "simulated", "ethercat"),
        fixed=True,
    ),
    Parameter(name="kernel.name", default="", about="a running kernel to lead", fixed=True),
    Parameter(
        name="state_publish_rate",
        default=50.0,
        about="of the joint states, Hz",
        low=0.1,
        high=1000.0,
        fixed=True,
    ),
)
_STREAM = (
    Parameter(
        name="stream.period", default=0.1, about="time between goals of a stream, s", low=1e-3,
        fixed=True,
    ),
    Parameter(
        name="stream.delay", default=4, about="periods that a stream runs behind its goals",
        low=1, high=10000, fixed=True,
    ),
    Parameter(
        name="stream.ahead", default=0.05, about="seconds before a piece is due, it is sent",
        low=1e-3, high=10.0, fixed=True,
    ),
    Parameter(
        name="track.horizon", default=0.1, about="seconds from now to the state aimed at",
        low=2e-3, high=10.0, fixed=True,
    ),
    Parameter(
        name="track.timeout", default=0.3, about="seconds without a message until it comes to rest",
        low=1e-3, high=1e3, fixed=True,
    ),
)  # fmt: skip
#: Of the trajectory controller.
CONTROLLER: tuple[Parameter, ...] = (
    *_KERNEL,
    Parameter(
        name="autostart", default=True, about="configure and activate without a manager", fixed=True
    ),
    Parameter(
        name="action_monitor_rate", default=20.0, about="of the feedback of goals, Hz", low=0.1,
        high=1000.0, fixed=True,
    ),
    Parameter(
        name="topic_mode",
        default="replace",
        about="what a message on ~/joint_trajectory does: a goal that replaces the one before, "
        "points of a stream, or a window to be tracked",
        choices=("replace", "stream", "track"),
        fixed=True,
    ),
    *_STREAM,
    Parameter(
        name="execution_mode", default="full_trajectory",
        about="every way-point, or only the last", choices=tuple(m.value for m in ExecutionMode),
    ),
    Parameter(
        name="resampling_delta", default=0.0,
        about="way-points nearer than this to the next one kept are left out, rad or m", low=0.0,
    ),
    Parameter(
        name="tolerance", default=0.0, about="way-points are passed so near, rad or m", low=0.0
    ),
    Parameter(name="use_velocities", default=False, about="take those of the trajectory"),
    Parameter(
        name="allow_partial_joints_goal", default=False, about="goals of some of the joints"
    ),
    Parameter(
        name="allow_nonzero_velocity_at_trajectory_end", default=False,
        about="goals whose last velocity is not 0; the motion ends at rest all the same",
    ),
    Parameter(
        name="speed", default=1.0, about="at which goals are played", low=0.0, high=2.0
    ),
    Parameter(
        name="constraints.stopped_velocity_tolerance", default=0.01,
        about="that counts as rest, rad/s or m/s", low=0.0,
    ),
    Parameter(
        name="constraints.goal_time", default=0.0,
        about="seconds to come within the goal tolerance; 0: for ever", low=0.0,
    ),
    Parameter(
        name="invalid_goals", default="reject",
        about="refuse a wrong goal, or take it and abort it, so that the client gets code and text",
        choices=("reject", "abort"),
    ),
    Parameter(
        name="cancel_result", default="at_rest",
        about="when a canceled goal is told: the joints rest, or at once",
        choices=("at_rest", "at_once"),
    ),
)  # fmt: skip
#: Of the control node.
CONTROL: tuple[Parameter, ...] = (
    *_KERNEL,
    Parameter(
        name="mode", default="interrupt",
        about="a goal replaces the move under way, is one of a stream, or is tracked",
        choices=("interrupt", "stream", "track"), fixed=True,
    ),
    Parameter(
        name="goal_topic", default="joint_states", about="joint states that are goals", fixed=True
    ),
    Parameter(
        name="state_topic", default="~/joint_states", about="the actual joint states", fixed=True
    ),
    Parameter(
        name="read_rate", default=0.0,
        about="goals are polled so often, Hz; 0: taken as they come", low=0.0, high=1000.0,
        fixed=True,
    ),
    Parameter(
        name="use_stamps", default=True, about="a stream goes by the stamps of its goals",
        fixed=True,
    ),
    *_STREAM,
)  # fmt: skip
#: Of joint_trajectory_controller, without a meaning here.
IGNORED = (
    "action_monitor_period",
    "command_interfaces",
    "command_joints",
    "state_interfaces",
    "interpolation_method",
    "open_loop_control",
    "allow_integration_in_goal_trajectories",
    "interpolate_from_desired_state",
    "set_last_command_interface_value_as_state_on_activation",
    "speed_scaling_topic_name",
    "cmd_timeout",
)


def constraints(names: Sequence[str]) -> tuple[Parameter, ...]:
    """The tolerances of each joint."""
    return tuple(
        Parameter(
            name=f"constraints.{name}.{kind}",
            default=0.0,
            about=f"how far the joint may be from {what}, rad or m; 0: unchecked",
            low=0.0,
        )
        for name in names
        for kind, what in (("trajectory", "its command"), ("goal", "the goal at the end"))
    )


def settings(values: Mapping[str, Any], joints: Joints) -> Settings:
    """What the parameters of the controller mean for goals, in axis units; raises InputError.

    >>> arm = Joints.of(["a"], ["mm"])
    >>> values = {p.name: p.default for p in (*CONTROLLER, *constraints(arm.names))}
    >>> settings(values | {"tolerance": 0.002, "constraints.a.goal": 0.01}, arm).tolerance
    2.0
    """

    def common(name: str) -> float:
        value = float(values[name])
        if value and (joints.scale != joints.scale[0]).any():
            what = "must be 0 where the axes of the kernel have different units"
            raise InputError(name, value, what)
        return value * float(joints.scale[0])

    def tolerances(kind: str) -> dict[str, Tolerance]:
        return {
            name: Tolerance(position=values[f"constraints.{name}.{kind}"] * joints.scale_of(name))
            for name in joints.names
            if values[f"constraints.{name}.{kind}"]
        }

    return Settings(
        execution_mode=values["execution_mode"],
        resampling_delta=common("resampling_delta"),
        speed=values["speed"],
        use_velocities=values["use_velocities"],
        tolerance=common("tolerance"),
        allow_partial_joints=values["allow_partial_joints_goal"],
        allow_end_velocity=values["allow_nonzero_velocity_at_trajectory_end"],
        path_tolerance=tolerances("trajectory"),
        goal_tolerance=tolerances("goal"),
        goal_time=values["constraints.goal_time"],
        stopped_velocity=values["constraints.stopped_velocity_tolerance"]
        * float(joints.scale.min()),
    )
