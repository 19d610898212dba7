"""Start the panel: which robot, which kernel, which links. Never here: pages, kernels."""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import time
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from sjerk.errors import SegmentMissingError, SjerkError
from sjerk.handshake import clean
from sjerk.host import Feedback
from sjerk.kernel import described, read_table
from sjerk.ports.panel.door import Role
from sjerk.ports.panel.server import PanelServer
from sjerk.ports.panel.settings import PanelSettings
from sjerk.ports.panel.watching import Watching

#: The robot that comes with sjerk.
SHIPPED = Path(__file__).resolve().parents[2] / "data" / "panda.toml"
_PATIENCE = 20.0


@dataclass(frozen=True)
class Order:
    """What ``sjerk panel`` is asked for."""

    robot: Path | None = None
    name: str | None = None
    port: int = 8200
    lead: bool = True
    open: bool = False
    any_owner: bool = False
    seconds: float = math.inf
    urdf: Path | None = None
    tip: str | None = None


def run(order: Order, show: Callable[[dict[str, object]], None]) -> int:
    """Be the panel until Ctrl-C or SIGTERM; a kernel that was started for it ends with it.

    ``show`` gets the links. Raises SjerkError, OSError.
    """
    robot = order.robot or SHIPPED
    table = read_table(robot)
    kernel = described(robot, table, name=order.name)  # checks the file, and starts nothing
    settings = PanelSettings.of(
        robot,
        table,
        len(kernel.axes),
        fixed=order.robot is None,
        urdf=order.urdf,
        tip=order.tip,
    )
    child = None
    if not _runs(kernel.name):
        child = _start(robot, kernel.name)
    try:
        watching = Watching(kernel.name, axes=len(kernel.axes), any_owner=order.any_owner)
        feedback = _first(watching, child)
        panel = PanelServer(
            settings,
            watching,
            feedback,
            port=order.port,
            lead=order.lead,
            any_owner=order.any_owner,
        )
        try:
            roles: tuple[Role, ...] = ("lead", "view")
            links: dict[str, object] = {
                role: link for role in roles if (link := panel.link(role)) is not None
            }
            started = "started" if child is not None else "found running"
            show({"kernel": kernel.name, "axes": len(kernel.axes), "it was": started, **links})
            with ExitStack() as opened, suppress(KeyboardInterrupt):
                if order.open:
                    opened.enter_context(_opened(str(links.get("lead", links["view"]))))
                panel.run(order.seconds)
        finally:
            panel.close()
    finally:
        if child is not None:
            child.terminate()
            child.wait()
    return 0


def _runs(name: str) -> bool:
    return any(info.name == name and info.kernel for info in clean(dry_run=True))


def _start(robot: Path, name: str) -> subprocess.Popen[bytes]:
    """A kernel in a process of its own, which Ctrl-C in the terminal does not reach."""
    return subprocess.Popen(
        [sys.executable, "-m", "sjerk", "kernel", str(robot), "--name", name],
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )


def _first(watching: Watching, child: subprocess.Popen[bytes] | None) -> Feedback:
    until = time.monotonic() + _PATIENCE
    while (feedback := watching.attach()) is None:
        if child is not None and child.poll() is not None:
            raise SjerkError("the kernel has not begun: it says why above")
        if time.monotonic() > until:
            raise SegmentMissingError(f"no kernel {watching.name!r} runs")
        time.sleep(0.05)
    return feedback


@contextmanager
def _opened(link: str) -> Iterator[None]:
    """Open the browser of this machine, by a file that only this user may read.

    What a program is started with can be read by everybody on the machine.
    """
    with tempfile.NamedTemporaryFile("w", suffix=".html", prefix="sjerk-panel-") as file:
        file.write(f'<meta http-equiv="refresh" content="0;url={link}">')
        file.flush()
        webbrowser.open(Path(file.name).as_uri())
        yield
