"""The trajectory controller: FollowJointTrajectory on a kernel, as a lifecycle node.

The names of topics, services and parameters are those of joint_trajectory_controller where it has
them; ``parameters.CONTROLLER`` has the parameters. All ROS calls happen in one thread: callbacks of
the executor of goals only wake it. Never here: motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

import rclpy
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState, SpeedScalingFactor
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from sjerk.errors import InputError, KernelGoneError, SjerkError
from sjerk.executor import GoalHandle, GoalStatus, ResultCode, Settings
from sjerk.host import Host
from sjerk.ports.ros.desk import Desk, Refusal
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.leading import KernelOf, joints_of, lead
from sjerk.ports.ros.messages import Rows
from sjerk.ports.ros.orders import LONGEST, Order
from sjerk.ports.ros.parameters import CONTROLLER, IGNORED, Parameter, constraints, settings
from sjerk.ports.ros.ros2_life import Waits, checks, declare, ignored, run, stops
from sjerk.ports.ros.ros2_messages import controller_state, goal_feedback
from sjerk.ports.ros.ros2_status import MotionStates, diagnostics, joint_state
from sjerk.ports.ros.status import Status, check, check_start, statuses, warnings
from sjerk.ports.ros.topic import TopicMotion

try:
    from cobot_msgs.srv import CobotApiSrv
except ImportError:  # only whoever has the cobot's panel needs it
    CobotApiSrv = None

_INACTIVE = Refusal(ResultCode.INVALID_GOAL, "the controller is not active")


class TrajectoryController(LifecycleNode):  # type: ignore[misc]
    """An action server, its topics and services, in front of a kernel."""

    def __init__(self, kernel_of: KernelOf) -> None:
        """Declares the parameters; raises InputError."""
        super().__init__("sjerk_trajectory_controller")
        declare(self, CONTROLLER)
        self._known: tuple[Parameter, ...] = CONTROLLER
        self._kernel_of = kernel_of
        self._open = ExitStack()
        self._host: Host | None = None
        self._joints: Joints | None = None
        self._desk: Desk | None = None
        self._closing: Desk | None = None  # its last results are being told
        self._finishing = False
        self._topic: TopicMotion | None = None
        self._speed = 1.0
        self._next: GoalHandle | Refusal = _INACTIVE
        self._goals: dict[bytes, tuple[ServerGoalHandle, GoalHandle, Future]] = {}
        self._wake = self.create_guard_condition(self._tell)
        self._waits = Waits(self)
        self._made: list[tuple[Callable[[Any], bool], Any]] = []
        self.add_on_set_parameters_callback(self._on_set)
        foreign = ignored(self, IGNORED)
        if foreign:
            self.get_logger().info(f"parameters without a meaning here: {', '.join(foreign)}")

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds * 1e-9)

    # ---- parameters

    def _settings(self, changed: Sequence[Any] = ()) -> Settings:
        assert self._joints is not None
        values = {parameter.name: self._value(parameter.name) for parameter in self._known}
        values |= {parameter.name: parameter.value for parameter in changed}
        return settings(values, self._joints)

    def _on_set(self, changed: Sequence[Any]) -> SetParametersResult:
        known = {parameter.name: parameter for parameter in self._known}
        try:
            for parameter in changed:
                if parameter.name in known:
                    known[parameter.name].check(parameter.value)
            if self._joints is not None:
                own = self._settings(changed)
                if self._desk is not None:
                    self._desk.set(own)
        except SjerkError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    # ---- lifecycle

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Kernel and interfaces; refuses with a text."""
        try:
            self._host = lead(self._value, self._open, self._kernel_of)
            joints = joints_of(self._value("joints"), self._host)
            self._known = (*CONTROLLER, *constraints(joints.names))
            declare(self, [p for p in self._known if not self.has_parameter(p.name)])
            self._joints = joints
            self._settings()
        except (SjerkError, TimeoutError, OSError) as error:
            self.get_logger().error(f"not configured: {error}")
            self.leave()
            return TransitionCallbackReturn.FAILURE
        self._topic = TopicMotion(self._host, self._joints, self._value)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._states = self._own(self.create_publisher, JointState, "joint_states", 10)
        self._reference = self._own(
            self.create_publisher, JointTrajectoryControllerState, "~/controller_state", 10
        )
        self._diagnostics = self._own(self.create_publisher, DiagnosticArray, "/diagnostics", 10)
        self._warnings = self._own(self.create_publisher, String, "~/warnings", 10)
        self._motion_states = MotionStates(self, self._joints)
        self._own(
            self.create_subscription, JointTrajectory, "~/joint_trajectory", self._on_topic, 10
        )
        self._own(
            self.create_subscription,
            SpeedScalingFactor,
            "~/speed_scaling_input",
            self._on_speed,
            latched,
        )
        self._action = ActionServer(
            self,
            FollowJointTrajectory,
            "~/follow_joint_trajectory",
            execute_callback=self._execute,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )
        stops(partial(self._own, self.create_service), self._on_order)
        checks(partial(self._own, self.create_service), self._check)
        self._own(self.create_service, SetBool, "~/hold", self._on_hold)
        if CobotApiSrv is not None:
            self._own(self.create_service, CobotApiSrv, "cobot_api_service", self._on_cobot)
        self._own(self.create_timer, 1.0 / self._value("state_publish_rate"), self._publish)
        self._own(self.create_timer, 1.0 / self._value("action_monitor_rate"), self._feedback)
        self._own(self.create_timer, 1.0, self._diagnose)
        self._own(self.create_timer, 0.01, self._turn)
        return TransitionCallbackReturn.SUCCESS

    def _own(self, create: Callable[..., Any], *arguments: Any, **more: Any) -> Any:
        """Something that lives until the node is cleaned up."""
        made = create(*arguments, **more)
        destroy = create.__name__.replace("create", "destroy")
        self._made.append((getattr(self, destroy), made))
        return made

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Drives enabled, goals taken."""
        assert self._host is not None
        assert self._joints is not None
        try:
            check_start(self._host, self._joints, self.get_logger().info)
            self._host.enable()
            self._desk = Desk(
                self._host,
                self._joints,
                settings=self._settings(),
                feedback_rate=self._value("action_monitor_rate"),
                clock=self._now,
                wake=self._wake.trigger,
            )
        except (SjerkError, TimeoutError) as error:
            self.get_logger().error(f"not active: {error}")
            return TransitionCallbackReturn.FAILURE
        return super().on_activate(state)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Goals aborted, at rest on the path, drives disabled."""
        self._close("deactivated")
        try:
            assert self._host is not None
            self._host.halt(10.0)
            self._host.disable()
        except (SjerkError, TimeoutError) as error:
            self.get_logger().error(f"deactivated: {error}")
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """The kernel is left, an own one ends."""
        self._tell()
        self._action.destroy()
        for destroy, made in reversed(self._made):
            destroy(made)
        self._made.clear()
        self._motion_states.destroy()
        self.leave()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """From any state: goals aborted, stop, leave."""
        self._close("shut down")
        if self._host is not None:
            try:
                self._host.halt(0.0)
            except SjerkError as error:
                self.get_logger().error(f"shut down: {error}")
        self._tell()
        self.leave()
        return TransitionCallbackReturn.SUCCESS

    def _close(self, reason: str) -> None:
        desk, self._desk = self._desk, None
        self._drop_topic()
        if desk is not None:
            desk.close(reason)
            self._closing = desk
        self._tell()

    def _drop_topic(self) -> None:
        """What came by topic is followed no more: another hand moves."""
        if self._topic is not None:
            self._topic.drop()

    # ---- goals

    def _on_goal(self, request: Any) -> GoalResponse:
        if self._desk is None:
            self._next = _INACTIVE
        else:
            self._drop_topic()
            self._next = self._desk.submit(request)
        if isinstance(self._next, Refusal):
            self.get_logger().error(f"goal refused: {self._next.code.name}: {self._next.text}")
            if self._value("invalid_goals") == "reject":
                return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_accepted(self, goal: ServerGoalHandle) -> None:
        if isinstance(self._next, GoalHandle):
            future = Future(executor=self.executor)
            self._goals[bytes(goal.goal_id.uuid)] = (goal, self._next, future)
            if self._speed != 1.0:
                self._next.speed(self._speed)
        goal.execute()
        self._wake.trigger()  # it may have ended before

    async def _execute(self, goal: ServerGoalHandle) -> Any:
        mine = self._goals.get(bytes(goal.goal_id.uuid))
        if mine is None:  # taken only to be told why not
            refusal = self._next if isinstance(self._next, Refusal) else _INACTIVE
            goal.abort()
            return _result(refusal.code, refusal.text)
        _, handle, ended = mine
        await ended
        del self._goals[bytes(goal.goal_id.uuid)]
        if handle.status is GoalStatus.SUCCEEDED:
            goal.succeed()
        elif handle.status is GoalStatus.CANCELED and goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return _result(handle.code, handle.text)

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        mine = self._goals.get(bytes(goal.goal_id.uuid))
        if mine is None:
            return CancelResponse.REJECT
        mine[1].cancel()
        self._wake.trigger()
        return CancelResponse.ACCEPT

    def _tell(self) -> None:
        """Results of goals that have ended reach their clients."""
        desk = self._desk or self._closing
        if desk is None:
            return
        ended = desk.ended(at_rest=self._value("cancel_result") == "at_rest")
        for _, handle, future in list(self._goals.values()):
            if handle in ended and not future.done():
                future.set_result(None)

    def _feedback(self) -> None:
        self._tell()
        if self._joints is None:
            return
        for goal, handle, _ in list(self._goals.values()):
            told = handle.feedback
            if handle.status is not GoalStatus.EXECUTING or told is None or not goal.is_active:
                continue
            stamp = self.get_clock().now().to_msg()
            goal.publish_feedback(goal_feedback(told, self._joints, stamp))

    def _on_topic(self, message: JointTrajectory, info: dict[str, int]) -> None:
        if self._desk is None or self._topic is None:
            self.get_logger().error("trajectory ignored: not active", throttle_duration_sec=1.0)
            return
        if self._topic.mode == "replace":
            self._replace(message)
            return
        try:
            for handle in self._desk.open:
                handle.cancel()
            self._topic.take(message, info["source_timestamp"] * 1e-9, self._now())
        except KernelGoneError:
            raise
        except SjerkError as error:
            self.get_logger().error(f"trajectory ignored: {error}", throttle_duration_sec=1.0)

    def _replace(self, message: JointTrajectory) -> None:
        assert self._desk is not None
        if not message.points:  # a stop
            for handle in self._desk.open:
                handle.cancel()
            return
        answer = self._desk.submit(message)
        if isinstance(answer, Refusal):
            text = f"trajectory ignored: {answer.code.name}: {answer.text}"
            self.get_logger().error(text, throttle_duration_sec=1.0)
        elif self._speed != 1.0:
            answer.speed(self._speed)

    # ---- orders

    def _on_speed(self, message: SpeedScalingFactor) -> None:
        try:
            if not 0.0 <= message.factor <= 2.0:
                raise InputError("factor", message.factor, "must lie in 0 .. 2")
            self._speed = message.factor
            if self._desk is not None:
                self._desk.speed(self._speed)
        except SjerkError as error:
            self.get_logger().error(f"speed ignored: {error}", throttle_duration_sec=1.0)

    async def _on_order(self, name: str) -> str:
        host = self._host
        if host is None:
            return _INACTIVE.text
        self._drop_topic()
        order = Order(host, name)
        await self._waits.until(order.look, LONGEST)
        return order.answer

    def _on_hold(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        try:
            for handle in self._desk.open if self._desk is not None else ():
                (handle.pause if request.data else handle.resume)()
            assert self._host is not None
            (self._host.hold if request.data else self._host.resume)()
            response.success, response.message = True, "done"
        except (SjerkError, TimeoutError) as error:
            response.success, response.message = False, str(error)
        return response

    def _on_cobot(self, request: Any, response: Any) -> Any:
        """Mode and resampling together or not at all; an error is acknowledged by a reset."""
        mode = "full_trajectory" if request.request_full_trajectory_mode else "single_point"
        answer = self.set_parameters_atomically(
            [
                rclpy.Parameter("execution_mode", value=mode),
                rclpy.Parameter("resampling_delta", value=float(request.resampling_delta)),
            ]
        )
        response.success, response.message = answer.successful, answer.reason or "done"
        if answer.successful and request.acknowledge_error and self._host is not None:
            try:
                self._host.reset()
            except (SjerkError, TimeoutError) as error:
                response.success, response.message = False, str(error)
        return response

    # ---- what is told

    def _check(self) -> list[Status]:
        """Before the start, joint by joint; where the kernel is gone, that."""
        if self._host is None or self._joints is None:
            return statuses(None, None)
        try:
            return check(self._host, self._joints)
        except SjerkError:
            return statuses(self._host, self._joints)

    def _publish(self) -> None:
        if self._host is None or self._joints is None:
            return  # cleaned up, and this timer was due before
        try:
            frame = self._host.feedback()
        except KernelGoneError as error:
            self._gone(error)
            return
        rows, now = Rows.of(frame, self._joints), self.get_clock().now().to_msg()
        names = self._joints.names
        self._states.publish(
            joint_state(names, rows.feedback_position, rows.feedback_velocity, now)
        )
        self._reference.publish(controller_state(names, rows, frame.path.speed, now))
        self._motion_states.publish(frame, rows, now)
        for text in warnings(self._host):
            self._warnings.publish(String(data=text))

    def _gone(self, error: SjerkError) -> None:
        """The kernel has ended: everybody is told, the node goes back to inactive."""
        if self._desk is not None:
            self.get_logger().error(f"the kernel is gone: {error}")
            self._close(str(error))
            self.trigger_deactivate()

    def _turn(self) -> None:
        """What is due without a message."""
        if self._topic is None or self._desk is None:
            return
        try:
            self._topic.turn(self._now())
        except KernelGoneError as error:
            self._gone(error)
        except SjerkError as error:
            self.get_logger().error(f"topic: {error}", throttle_duration_sec=1.0)
            self._topic.drop()

    def _diagnose(self) -> None:
        goals = {"open": len(self._goals), "active": self._desk is not None}
        rows = statuses(self._host, self._joints, {"goals": goals})
        self._diagnostics.publish(diagnostics(self, rows))

    # ---- life

    def spin(self, executor: SingleThreadedExecutor) -> None:
        """One turn."""
        executor.spin_once(timeout_sec=0.1)

    def finish(self) -> bool:
        """End the goals and stop; whether it rests and all has been told."""
        self._tell()
        try:
            if not self._finishing:
                self._finishing = True
                self._close("shut down")
                if self._host is not None:
                    self._host.halt(0.0)
            return not self._goals and (self._host is None or not self._host.feedback().moving)
        except SjerkError:
            return not self._goals

    def leave(self) -> None:
        """Leave the kernel; end it where it is a child. Nothing asks after its goals any more."""
        self._host = self._desk = self._closing = None
        for _, _, future in self._goals.values():
            if not future.done():
                future.set_result(None)
        self._open.close()
        self._open = ExitStack()


def _result(code: ResultCode, text: str) -> Any:
    return FollowJointTrajectory.Result(error_code=int(code), error_string=text)


def _made(kernel_of: KernelOf) -> TrajectoryController:
    node = TrajectoryController(kernel_of)
    if node.get_parameter("autostart").value:
        done = node.trigger_configure() == TransitionCallbackReturn.SUCCESS
        if not (done and node.trigger_activate() == TransitionCallbackReturn.SUCCESS):
            node.leave()
            raise SjerkError("the controller did not become active; the lines above say why")
    return node


def main(arguments: Sequence[str] | None, kernel_of: KernelOf) -> int:
    """Run the node; ``arguments`` as of ROS; returns the exit code."""
    return run(lambda: _made(kernel_of), arguments)
