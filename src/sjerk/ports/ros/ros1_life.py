"""The life of a ROS 1 node: its parameters, its kernel, its signals, its end. Never here: topics.

rospy's own handlers of signals are not used: they would end the node's connections first, so that
nobody could be told any more.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import rospy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger, TriggerResponse

from sjerk.errors import InputError, SjerkError
from sjerk.host import Host
from sjerk.ports.ros.joints import Joints
from sjerk.ports.ros.leading import KernelOf, joints_of, lead
from sjerk.ports.ros.orders import LONGEST, ORDERS, Order
from sjerk.ports.ros.parameters import IGNORED, Parameter
from sjerk.ports.ros.status import Level, Status, check, check_start, statuses
from sjerk.ports.ros.turns import Turns
from sjerk.profile import FloatArray

#: Seconds that results may take to reach their clients when a node ends.
_FAREWELL = 0.3


def flat(tree: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """The leaves of a tree of parameters, by names with dots."""
    found: dict[str, Any] = {}
    for name, value in tree.items():
        if isinstance(value, Mapping):
            found |= flat(value, f"{before}{name}.")
        else:
            found[before + name] = value
    return found


def read(known: Sequence[Parameter]) -> tuple[dict[str, Any], list[str]]:
    """The parameters of this node on the server, checked, and names there that mean nothing.

    Slashes are dots in ``known``. Raises InputError for a value that is none.
    """
    given = flat(rospy.get_param("~", {}) or {})
    values: dict[str, Any] = {}
    for parameter in known:
        value = given.pop(parameter.name, parameter.default)
        if isinstance(parameter.default, float) and type(value) is int:
            value = float(value)
        parameter.check(value)
        values[parameter.name] = value
    return values, sorted(given)


class Life:
    """What both nodes have: kernel, joints, loop, services that stop, diagnostics."""

    def __init__(self, known: Sequence[Parameter], kernel_of: KernelOf) -> None:
        """Leads the kernel and enables its drives; raises SjerkError and its like."""
        self.values, foreign = read(known)
        self.turns = Turns()
        self.open = ExitStack()
        try:
            self.host: Host = lead(self.values.__getitem__, self.open, kernel_of)
            self.joints: Joints = joints_of(self.values["joints"], self.host)
            check_start(self.host, self.joints, rospy.loginfo)
            self.host.enable()
        except BaseException:
            self.open.close()
            raise
        own = tuple(f"constraints.{name}." for name in self.joints.names)
        without = [name for name in foreign if name in IGNORED]
        unknown = [n for n in foreign if n not in IGNORED and not n.startswith(own)]
        for names, what in ((without, "without a meaning here"), (unknown, "not known")):
            if names:
                rospy.logwarn("parameters %s: %s", what, ", ".join(names))
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)

    def value(self, name: str) -> Any:
        """A parameter as it was when the node began."""
        return self.values[name]

    def offer_stops(self, drop: Callable[[], None]) -> None:
        """The services ``~halt``, ``~quick_stop``, ``~reset``, answered at rest, and ``~check``."""

        def serve(name: str) -> Callable[[Any], TriggerResponse]:
            def give(answer: Callable[[str], None]) -> None:
                drop()
                order = Order(self.host, name)
                self.turns.until(order.look, LONGEST, lambda _: answer(order.answer))

            return lambda _: self._answer(give)

        for name in ORDERS:
            rospy.Service(f"~{name}", Trigger, serve(name))
        rospy.Service("~check", Trigger, lambda _: self.turns.ask(self._check, LONGEST))

    def _answer(self, order: Callable[[Callable[[str], None]], Any]) -> TriggerResponse:
        text = self.turns.ask(order, LONGEST + 5.0)
        return TriggerResponse(success=not text, message=text or "done")

    def _check(self, answer: Callable[[TriggerResponse], None]) -> None:
        try:
            rows = check(self.host, self.joints)
        except SjerkError:
            rows = statuses(self.host, self.joints)
        good = all(row.level < Level.ERROR for row in rows)
        answer(
            TriggerResponse(success=good, message="\n".join(f"{r.what}: {r.text}" for r in rows))
        )

    def rests(self) -> bool:
        """Whether nothing moves; also where the kernel is gone."""
        try:
            return not self.host.feedback().moving
        except SjerkError:
            return True

    def diagnose(self, more: Mapping[str, Mapping[str, object]]) -> None:
        """Publish diagnostics."""
        message = DiagnosticArray()
        message.header.stamp = rospy.Time.now()
        message.status = [_row(row) for row in statuses(self.host, self.joints, more)]
        self._diagnostics.publish(message)


def _row(row: Status) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=int(row.level),
        name=f"{rospy.get_name()}: {row.what}",
        message=row.text,
        hardware_id="sjerk",
        values=[KeyValue(key=key, value=str(value)) for key, value in row.values.items()],
    )


def joint_state(
    names: Sequence[str], position: FloatArray, velocity: FloatArray, stamp: Any
) -> JointState:
    """All joints in one cycle."""
    message = JointState(name=list(names), position=position.tolist(), velocity=velocity.tolist())
    message.header.stamp = stamp
    return message


def put(file: Path) -> None:
    """Set this node's parameters as a YAML file has them; one of ROS 2 does as well."""
    tree = yaml.safe_load(file.read_text()) or {}
    for section in tree.values() if isinstance(tree, dict) else ():
        if isinstance(section, dict) and "ros__parameters" in section:
            tree = section["ros__parameters"]
    if not isinstance(tree, dict):
        raise InputError("params", str(file), "must be a YAML file of parameters by name")
    for name, value in flat(tree).items():
        rospy.set_param("~" + name.replace(".", "/"), value)


def run(
    name: str, make: Callable[[], Any], arguments: Sequence[str] | None, params: Path | None
) -> int:
    """Spin the node that ``make`` makes until SIGINT or SIGTERM; the exit code.

    The node has ``spin()``, one turn, ``finish()``, asked until nothing moves and all has been
    told, and ``leave()``.
    """
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda n, _: ended.append(n))
    rospy.init_node(
        name, argv=None if arguments is None else ["sjerk", *arguments], disable_signals=True
    )
    code = 0
    node = None
    try:
        if params is not None:
            put(params)
        node = make()
        while not ended and not rospy.is_shutdown():
            node.spin()
        until = time.monotonic() + 5.0
        while not node.finish() and time.monotonic() < until:
            node.turns.turn(0.02)
        until = time.monotonic() + _FAREWELL
        while time.monotonic() < until:
            node.turns.turn(0.02)
    except (SjerkError, TimeoutError, OSError) as error:
        rospy.logerr("%s: %s", type(error).__name__, error)
        code = 1
    finally:
        if node is not None:
            node.leave()
        rospy.signal_shutdown("ended")
    return code
