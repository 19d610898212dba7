"""The control node: joint states are goals, the kernel's command and feedback are joint states.

The paper's node: goals come every 0.1 s, each interrupts the move under way. With other topics it
is the far end of a topic-based hardware interface. ``parameters.CONTROL`` has its parameters. Never
here: motion.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import JointState

from sjerk.errors import KernelGoneError, SjerkError
from sjerk.executor import StreamPlayer
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.messages import Rows
from sjerk.ports.ros.parameters import CONTROL
from sjerk.ports.ros.ros2_life import Waits, declare, joints_of, lead, run, stops
from sjerk.ports.ros.ros2_status import MotionStates, diagnostics
from sjerk.ports.ros.tracking import SHARE, Rest, Tracker, Window
from sjerk.profile import FloatArray


class ControlNode(Node):  # type: ignore[misc]
    """Joint states in, motion of the kernel, joint states out."""

    def __init__(self) -> None:
        """Leads the kernel and enables its drives; raises SjerkError and its like."""
        super().__init__("sjerk_control_node")
        declare(self, CONTROL)
        self._open = ExitStack()
        self._host = lead(self, self._open)
        self._joints: Joints = joints_of(self, self._host)
        self._host.enable()
        self._mode = self._value("mode")
        self._counts: Counter[str] = Counter()
        self._ages: list[float] = []
        self._last: FloatArray | None = None
        self._before: tuple[float, FloatArray] | None = None
        self._player: StreamPlayer | None = None
        self._first, self._came, self._finishing = 0.0, 0.0, False
        axes = self._host.feedback().axes
        self._tracker = Tracker(
            horizon=self._value("track.horizon"),
            timeout=self._value("track.timeout"),
            most=[SHARE * axis.limits.velocity for axis in axes],
            rest_on_last=True,
        )
        self._waits = Waits(self)
        self._commands = self.create_publisher(JointState, "~/command", qos_profile_sensor_data)
        self._states = self.create_publisher(JointState, self._value("state_topic"), 10)
        self._motion_states = MotionStates(self, self._joints)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        # Best effort takes goals from reliable publishers and from others.
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(JointState, self._value("goal_topic"), self._on_goal, qos)
        stops(self.create_service, self._on_order)
        self.create_timer(1.0 / self._value("state_publish_rate"), self._publish)
        self.create_timer(1.0, self._diagnose)
        self.create_timer(0.01, self._turn)
        rate = self._value("read_rate")
        self._every, self._due = (1.0 / rate if rate else 0.0), time.monotonic()

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds * 1e-9)

    # ---- goals

    def _on_goal(self, message: JointState) -> None:
        self._counts["goals"] += 1
        now = self._now()
        stamp = message.header.stamp
        sent = stamp.sec + 1e-9 * stamp.nanosec or now
        self._ages.append(now - sent)
        try:
            goal = self._joints.row(message.name, message.position, "position")
            own = len(message.velocity) > 0
            velocity = self._joints.row(message.name, message.velocity, "velocity") if own else None
            getattr(self, f"_{self._mode}")(goal, velocity, sent, now)
        except KernelGoneError:
            raise
        except SjerkError as error:
            self._counts["refused"] += 1
            self.get_logger().error(f"goal refused: {error}", throttle_duration_sec=1.0)

    def _interrupt(
        self, goal: FloatArray, velocity: FloatArray | None, sent: float, now: float
    ) -> None:
        """The paper: each new goal replaces the move under way."""
        if self._last is not None and (goal == self._last).all():
            self._counts["unchanged"] += 1
            return
        self._host.move(goal.tolist())
        self._last = goal

    def _stream(
        self, goal: FloatArray, velocity: FloatArray | None, sent: float, now: float
    ) -> None:
        """One of a stream, at its time."""
        self._came = now
        if self._player is None:
            axes = self._host.feedback().axes
            if all(q == axis.position for q, axis in zip(goal, axes, strict=True)):
                self._counts["unchanged"] += 1
                return
            self._player = StreamPlayer(
                self._host,
                period=self._value("stream.period"),
                delay=self._value("stream.delay"),
                ahead=self._value("stream.ahead"),
            )
            self._first = sent
        by_stamp = sent - self._first if self._value("use_stamps") else None
        self._player.push(goal, by_stamp, velocity=velocity)

    def _track(
        self, goal: FloatArray, velocity: FloatArray | None, sent: float, now: float
    ) -> None:
        """The newest goal, with its velocity or one by its difference to the goal before."""
        before, self._before = self._before, (sent, goal)
        if velocity is None:
            apart = sent - before[0] if before else 0.0
            usable = before is not None and 0.0 < apart <= self._value("track.timeout")
            velocity = (goal - before[1]) / apart if before and usable else np.zeros(len(goal))
        self._tracker.take(Window.of([sent], [goal], [velocity]), now)

    def _turn(self) -> None:
        """What is due without a message."""
        now = self._now()
        if self._tracker.active:
            self._aim(now)
        if self._player is not None:
            self._end_stream(now)

    def _aim(self, now: float) -> None:
        """What is tracked; where it cannot be followed the motion comes to rest."""
        try:
            aim = self._tracker.aim(now)
            if aim is Rest.HALT:
                self._host.halt(0.0)
            elif aim is not None:
                self._host.move(aim, synchronization="none", min_duration=self._tracker.horizon)
        except KernelGoneError:
            raise
        except SjerkError as error:
            self.get_logger().error(f"tracking: {error}", throttle_duration_sec=1.0)
            self._tracker.drop()
            self._host.halt(0.0)

    def _end_stream(self, now: float) -> None:
        """A stream whose goals have stopped to come ends at rest on the last of them."""
        player = self._player
        assert player is not None
        try:
            if now - self._came > 3.0 * self._value("stream.period"):
                player.end()
            if player.done:
                player.close()
                self._player = None
        except KernelGoneError:
            raise
        except SjerkError as error:
            self.get_logger().error(f"stream: {error}")
            player.close()
            self._player = None

    # ---- orders

    async def _on_order(self, name: str) -> str:
        try:
            self._drop()
            getattr(self._host, name)(timeout=0.0)
        except SjerkError as error:
            return str(error)
        rests = await self._waits.until(lambda: not self._host.feedback().moving, 30.0)
        return "" if rests else "not at rest within 30 s"

    # ---- what is told

    def _publish(self) -> None:
        frame = self._host.feedback()
        rows, now = Rows.of(frame, self._joints), self.get_clock().now().to_msg()
        for publisher, position, velocity in (
            (self._commands, rows.command_position, rows.command_velocity),
            (self._states, rows.feedback_position, rows.feedback_velocity),
        ):
            message = JointState(
                name=list(self._joints.names), position=position, velocity=velocity
            )
            message.header.stamp = now
            publisher.publish(message)
        self._motion_states.publish(frame, rows, now)

    def _diagnose(self) -> None:
        ages, self._ages = np.array(self._ages or [0.0]), []
        told: dict[str, object] = {
            "goals": self._counts["goals"],
            "refused": self._counts["refused"],
            "unchanged": self._counts["unchanged"],
            "age_p50_ms": round(1e3 * float(np.median(ages)), 3),
            "age_max_ms": round(1e3 * float(ages.max()), 3),
        }
        if self._player is not None:
            report = self._player.report
            told |= {"stream_lag": round(report.lag, 4), "stream_starved": report.starved}
        self._diagnostics.publish(
            diagnostics(self, self._host, self._joints, {f"goals, {self._mode}": told})
        )

    # ---- life

    def spin(self, executor: SingleThreadedExecutor) -> None:
        """Take what has come; polled, everything that has come since the poll before."""
        if not self._every:
            executor.spin_once(timeout_sec=0.1)
            return
        for _ in range(100):
            before = self._counts["goals"]
            executor.spin_once(timeout_sec=0.0)
            if self._counts["goals"] == before:
                break
        self._due = max(self._due + self._every, time.monotonic())
        time.sleep(max(0.0, self._due - time.monotonic()))

    def _drop(self) -> None:
        """Follow no goal that came before."""
        self._tracker.drop()
        if self._player is not None:
            self._player.close()
        self._player = self._last = self._before = None

    def finish(self) -> bool:
        """Stop what moves; whether it rests."""
        try:
            if not self._finishing:
                self._finishing = True
                self._drop()
                self._host.halt(0.0)
            return not self._host.feedback().moving
        except SjerkError:
            return True

    def leave(self) -> None:
        """Leave the kernel; end it where it is a child."""
        self._open.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node; ``arguments`` as of ROS; returns the exit code."""
    return run(ControlNode, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
