"""The trajectory controller of ROS 1: FollowJointTrajectory on a kernel, by rospy and actionlib.

The same names and parameters as in ROS 2, on the parameter server, read anew for each goal; a
trajectory comes on ``~command`` too. All of it happens in one loop. Never here: motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import actionlib
import rospy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool, SetBoolResponse
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sjerk.errors import InputError, KernelGoneError, SjerkError
from sjerk.executor import GoalHandle, GoalStatus, ResultCode
from sjerk.ports.ros.desk import Desk, Refusal
from sjerk.ports.ros.leading import KernelOf
from sjerk.ports.ros.messages import Rows
from sjerk.ports.ros.parameters import CONTROLLER, constraints, settings
from sjerk.ports.ros.ros1_interfaces import interfaces
from sjerk.ports.ros.ros1_life import Life, joint_state, read, run
from sjerk.ports.ros.status import warnings
from sjerk.ports.ros.topic import TopicMotion

_TYPES = interfaces()


class TrajectoryController(Life):
    """An action server, its topics and services, in front of a kernel."""

    def __init__(self, kernel_of: KernelOf) -> None:
        """Leads the kernel and enables its drives; raises SjerkError and its like."""
        super().__init__(CONTROLLER, kernel_of)
        self._known = (*CONTROLLER, *constraints(self.joints.names))
        self._speed, self._finishing = 1.0, False
        self._goals: dict[str, tuple[Any, GoalHandle]] = {}
        self._desk = Desk(
            self.host,
            self.joints,
            settings=settings(read(self._known)[0], self.joints),
            feedback_rate=self.value("action_monitor_rate"),
            clock=rospy.get_time,
            wake=lambda: self.turns.post(self._tell),
        )
        self._topic = TopicMotion(self.host, self.joints, self.value)
        self._states = rospy.Publisher("joint_states", JointState, queue_size=10)
        self._warnings = rospy.Publisher("~warnings", String, queue_size=10)
        for name, kind, job in (
            ("~command", JointTrajectory, self._on_topic),
            ("~speed_scaling_input", Float64, self._on_speed),
        ):
            rospy.Subscriber(name, kind, self._later, job, queue_size=10, tcp_nodelay=True)
        self.offer_stops(self._topic.drop)
        rospy.Service("~hold", SetBool, lambda request: self._hold(bool(request.data)))
        self._server = actionlib.ActionServer(
            f"{rospy.get_name()}/follow_joint_trajectory",
            _TYPES.Action,
            lambda goal: self.turns.post(lambda: self._on_goal(goal)),
            lambda goal: self.turns.post(lambda: self._on_cancel(goal)),
            auto_start=False,
        )
        self._server.start()
        self.turns.every(1.0 / self.value("state_publish_rate"), self._publish)
        self.turns.every(1.0 / self.value("action_monitor_rate"), self._feedback)
        self.turns.every(0.01, self._turn)
        self.turns.every(1.0, lambda: self.diagnose({"goals": {"open": len(self._goals)}}))

    def _later(self, message: Any, job: Any) -> None:
        """Hand a message over from rospy's thread, with the moment at which it came."""
        came = rospy.get_time()
        self.turns.post(lambda: job(message, came))

    # ---- goals

    def _on_goal(self, goal: Any) -> None:
        if self._finishing:
            self._refuse(goal, Refusal(ResultCode.INVALID_GOAL, "shut down"))
            return
        try:
            values, _ = read(self._known)
            self._desk.set(settings(values, self.joints))
            self.values |= {name: values[name] for name in ("invalid_goals", "cancel_result")}
        except SjerkError as error:
            self._refuse(goal, Refusal(ResultCode.INVALID_GOAL, str(error)))
            return
        self._topic.drop()
        answer = self._desk.submit(goal.get_goal())
        if isinstance(answer, Refusal):
            self._refuse(goal, answer)
            return
        if self._speed != 1.0:
            answer.speed(self._speed)
        goal.set_accepted()
        self._goals[goal.get_goal_id().id] = (goal, answer)
        self._tell()  # it may have ended before

    def _refuse(self, goal: Any, refusal: Refusal) -> None:
        """By default a rejection, which has code and text in ROS 1."""
        rospy.logerr("goal refused: %s: %s", refusal.code.name, refusal.text)
        result = _result(refusal.code, refusal.text)
        if self.value("invalid_goals") == "reject":
            goal.set_rejected(result, refusal.text)
        else:
            goal.set_accepted()
            goal.set_aborted(result, refusal.text)

    def _on_cancel(self, goal: Any) -> None:
        mine = self._goals.get(goal.get_goal_id().id)
        if mine is not None:
            mine[1].cancel()
            self._tell()

    def _tell(self) -> None:
        """Results of goals that have ended reach their clients."""
        ended = self._desk.ended(at_rest=self.value("cancel_result") == "at_rest")
        for name, (goal, handle) in list(self._goals.items()):
            if handle not in ended:
                continue
            del self._goals[name]
            result = _result(handle.code, handle.text)
            if handle.status is GoalStatus.SUCCEEDED:
                goal.set_succeeded(result, handle.text)
            elif handle.status is GoalStatus.CANCELED:
                goal.set_canceled(result, handle.text)
            else:
                goal.set_aborted(result, handle.text)

    def _feedback(self) -> None:
        self._tell()
        for goal, handle in self._goals.values():
            told = handle.feedback
            if handle.status is not GoalStatus.EXECUTING or told is None:
                continue
            scale = [self.joints.scale_of(name) for name in told.joint_names]
            message = _TYPES.Feedback(joint_names=list(told.joint_names))
            message.header.stamp = rospy.Time.now()
            for name, position, velocity in (
                ("desired", told.desired, told.desired_velocity),
                ("actual", told.actual, told.actual_velocity),
                ("error", told.error, told.desired_velocity - told.actual_velocity),
            ):
                point = JointTrajectoryPoint(
                    positions=(position / scale).tolist(),
                    velocities=(velocity / scale).tolist(),
                    time_from_start=rospy.Duration(max(0.0, told.time)),
                )
                setattr(message, name, point)
            goal.publish_feedback(message)

    def _on_topic(self, message: JointTrajectory, came: float) -> None:
        if self._finishing:
            return
        try:
            if self._topic.mode != "replace":
                for handle in self._desk.open:
                    handle.cancel()
                self._topic.take(message, came, rospy.get_time())
            elif not message.points:  # a stop
                for handle in self._desk.open:
                    handle.cancel()
            else:
                self._desk.set(settings(read(self._known)[0], self.joints))
                answer = self._desk.submit(message)
                if isinstance(answer, Refusal):
                    raise InputError("trajectory", answer.code.name, answer.text)
                if self._speed != 1.0:
                    answer.speed(self._speed)
        except KernelGoneError:
            raise
        except SjerkError as error:
            rospy.logerr_throttle(1.0, f"trajectory ignored: {error}")

    # ---- orders

    def _on_speed(self, message: Float64, came: float) -> None:
        try:
            if not 0.0 <= message.data <= 2.0:
                raise InputError("speed", message.data, "must lie in 0 .. 2")
            self._speed = message.data
            self._desk.speed(self._speed)
        except SjerkError as error:
            rospy.logerr_throttle(1.0, f"speed ignored: {error}")

    def _hold(self, held: bool) -> SetBoolResponse:
        def order(answer: Any) -> None:
            try:
                for handle in self._desk.open:
                    (handle.pause if held else handle.resume)()
                (self.host.hold if held else self.host.resume)()
                answer("")
            except (SjerkError, TimeoutError) as error:
                answer(str(error))

        text = self.turns.ask(order, 10.0)
        return SetBoolResponse(success=not text, message=text or "done")

    # ---- what is told

    def _publish(self) -> None:
        frame = self.host.feedback()
        rows, now = Rows.of(frame, self.joints), rospy.Time.now()
        names = self.joints.names
        self._states.publish(
            joint_state(names, rows.feedback_position, rows.feedback_velocity, now)
        )
        for text in warnings(self.host):
            self._warnings.publish(String(data=text))

    def _turn(self) -> None:
        """What is due without a message."""
        try:
            self._topic.turn(rospy.get_time())
        except KernelGoneError:
            raise
        except SjerkError as error:
            rospy.logerr_throttle(1.0, f"topic: {error}")
            self._topic.drop()

    # ---- life

    def spin(self) -> None:
        """One turn; a kernel that is gone ends the node, after its clients have been told."""
        try:
            self.turns.turn(0.1)
        except KernelGoneError as error:
            self._close(str(error))
            raise

    def _close(self, reason: str) -> None:
        """End the goals, and tell it."""
        self._finishing = True
        self._topic.drop()
        self._desk.close(reason)
        self._tell()

    def finish(self) -> bool:
        """End the goals and stop; whether it rests and all has been told."""
        if not self._finishing:
            self._close("shut down")
            try:
                self.host.halt(0.0)
            except SjerkError as error:
                rospy.logerr("shut down: %s", error)
        self._tell()
        return not self._goals and self.rests()

    def leave(self) -> None:
        """Leave the kernel; end it where it is a child."""
        self.open.close()


def _result(code: ResultCode, text: str) -> Any:
    return _TYPES.Result(error_code=int(code), error_string=text)


def main(arguments: Sequence[str] | None, params: Path | None, kernel_of: KernelOf) -> int:
    """Run the node; ``arguments`` as of ROS, ``params`` a YAML file; returns the exit code."""
    return run(
        "sjerk_trajectory_controller", lambda: TrajectoryController(kernel_of), arguments, params
    )
