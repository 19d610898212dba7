"""The life of a node: its parameters, its kernel, its signals, its end. Never here: topics.

rclpy's own handler of SIGINT would end the context first, so that nobody could be told any more;
here signals only wake the executor, a second one changes nothing, and the node ends in order.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_srvs.srv import Trigger

from sjerk.errors import SjerkError
from sjerk.ports.ros.orders import ORDERS
from sjerk.ports.ros.parameters import Parameter
from sjerk.ports.ros.status import Level, Status

#: Seconds that results may take to reach their clients when a node ends.
_FAREWELL = 0.2


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """A parameter as ROS describes it."""
    told = ParameterDescriptor(description=parameter.about, read_only=parameter.fixed)
    if parameter.choices:
        told.additional_constraints = f"one of {', '.join(parameter.choices)}"
    if parameter.low is not None and isinstance(parameter.default, float):
        told.floating_point_range = [
            FloatingPointRange(from_value=parameter.low, to_value=parameter.high)
        ]
    elif parameter.low is not None:
        told.integer_range = [
            IntegerRange(from_value=int(parameter.low), to_value=int(parameter.high), step=1)
        ]
    return told


def declare(node: Node, parameters: Sequence[Parameter]) -> None:
    """Declare parameters with their ranges; raises InputError for a value that is none."""
    for parameter in parameters:
        value = node.declare_parameter(
            parameter.name, parameter.default, descriptor(parameter)
        ).value
        parameter.check(value)


def ignored(node: Node, names: Sequence[str]) -> list[str]:
    """Which of these parameters, that mean nothing here, have been given to a node."""
    any_type = ParameterDescriptor(dynamic_typing=True)
    found = [
        name for name in names if node.declare_parameter(name, None, any_type).value is not None
    ]
    for name in names:
        node.undeclare_parameter(name)
    return found


def stops(create: Callable[..., Any], answer: Callable[[str], Any]) -> None:
    """The services ``~/halt``, ``~/quick_stop`` and ``~/reset``.

    ``create`` makes a service of the node; ``answer`` is a coroutine that gives the order and
    returns why it failed, or nothing.
    """
    # One that waits would hold up all others of its group, and with them what it waits for.
    group = ReentrantCallbackGroup()

    def offer(name: str) -> None:
        async def serve(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.message = await answer(name)
            response.success = not response.message
            return response

        create(Trigger, f"~/{name}", serve, callback_group=group)

    for name in ORDERS:
        offer(name)


def checks(create: Callable[..., Any], look: Callable[[], Sequence[Status]]) -> None:
    """The service ``~/check``: whether bus, drive and cycle of each joint are ready."""

    def serve(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        rows = look()
        response.success = all(row.level < Level.ERROR for row in rows)
        response.message = "\n".join(f"{row.what}: {row.text}" for row in rows)
        return response

    create(Trigger, "~/check", serve)


class Waits:
    """Coroutines of one node that wait for a condition, looked at by a timer of the node."""

    def __init__(self, node: Node) -> None:
        """Of this node."""
        self._node = node
        self._waiting: list[tuple[Callable[[], bool], float, Future]] = []
        node.create_timer(5e-3, self._look)

    def until(self, condition: Callable[[], bool], timeout: float) -> Future:
        """A future: whether the condition came within the time (s)."""
        future = Future(executor=self._node.executor)
        self._waiting.append((condition, time.monotonic() + timeout, future))
        return future

    def _look(self) -> None:
        still = []
        for condition, end, future in self._waiting:
            try:
                came = condition()
            except SjerkError:
                came, end = False, 0.0
            if came or time.monotonic() > end:
                future.set_result(came)
            else:
                still.append((condition, end, future))
        self._waiting = still


def turned(executor: SingleThreadedExecutor) -> bool:
    """Run one callback that is ready, a timer's too; whether there was one."""
    try:
        task, _, _ = executor.wait_for_ready_callbacks(timeout_sec=0.0)
    except (TimeoutException, ShutdownException):
        return False
    task()
    error = task.exception()
    if error is not None:
        raise error
    return True


def run(make: Callable[[], Any], arguments: Sequence[str] | None) -> int:
    """Spin the node that ``make`` makes until SIGINT or SIGTERM; the exit code.

    The node has ``finish()``, which stops what moves and returns whether all has been told, and is
    asked until it has; and ``spin(executor)``, one turn of the loop.
    """
    rclpy.init(
        args=None if arguments is None else list(arguments),
        signal_handler_options=SignalHandlerOptions.NO,
    )
    ended: list[int] = []
    executor = SingleThreadedExecutor()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda n, _: ended.append(n))
    code = 0
    node = None
    try:
        node = make()
        executor.add_node(node)
        while not ended:
            node.spin(executor)
        until = time.monotonic() + 5.0
        while not node.finish() and time.monotonic() < until:
            executor.spin_once(timeout_sec=0.02)
        until = time.monotonic() + _FAREWELL
        while time.monotonic() < until:
            executor.spin_once(timeout_sec=0.02)
    except (SjerkError, TimeoutError, OSError) as error:
        rclpy.logging.get_logger("sjerk").error(f"{type(error).__name__}: {error}")
        code = 1
    finally:
        if node is not None:
            node.leave()
            node.destroy_node()
        rclpy.try_shutdown()
    return code
