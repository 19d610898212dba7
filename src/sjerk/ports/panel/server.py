"""The panel at work: one web server behind the door, one loop that reads the kernel.

Never here: what a page has, what an order does.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import viser

from sjerk.errors import KernelGoneError, SjerkError
from sjerk.host import Feedback
from sjerk.ports.panel.board import Board
from sjerk.ports.panel.desk import Desk
from sjerk.ports.panel.door import Door, Role
from sjerk.ports.panel.journal import Journal
from sjerk.ports.panel.lead import Lead
from sjerk.ports.panel.page import Page
from sjerk.ports.panel.settings import PanelSettings
from sjerk.ports.panel.watching import Watching

#: Frames, plots and texts per second.
FRAMES, PLOTS, TEXTS = 40.0, 10.0, 5.0


class PanelServer:
    """Of the kernel that ``watching`` has found, with its first ``feedback``."""

    def __init__(
        self,
        settings: PanelSettings,
        watching: Watching,
        feedback: Feedback,
        *,
        port: int = 8200,
        lead: bool = True,
        any_owner: bool = False,
        folder: Path | None = None,
    ) -> None:
        """Raises DoorOpenError, OSError where no port is free, SjerkError for another robot."""
        self.journal = Journal()
        self.watching = watching
        self.door = Door(lead=lead, tell=lambda what: self.journal.tell(what, bad=True))
        self._lead = Lead(watching, self.journal.tell, any_owner=any_owner)
        self.desk = Desk(
            settings,
            watching,
            self._lead,
            self.journal,
            feedback,
            folder=folder or Path.cwd(),
            any_owner=any_owner,
        )
        with self.door.hung(), _quiet():
            self.server = viser.ViserServer(
                host="127.0.0.1", port=port, label="sjerk", verbose=False
            )
        self.port: int = self.server.get_port()
        try:
            self.door.prove(self.port)
        except BaseException:
            self._stop_server()
            self._lead.close()
            raise
        # any browser may ask viser for a public tunnel
        self.server.request_share_url = self._no_tunnel
        self.server.disconnect_share_url = lambda *a, **k: None
        self._noise = _Refused()
        logging.getLogger("asyncio").addFilter(self._noise)
        self.board = Board(self.server, self.desk)
        self._pages: dict[int, Page] = {}
        self._gone: set[int] = set()  # browsers that have left before their page was made
        self._coming, self._building = threading.Lock(), threading.Lock()
        self._leaving = ThreadPoolExecutor(4, thread_name_prefix="leaving")
        self._end = threading.Event()
        self.server.on_client_connect(self._came)
        self.server.on_client_disconnect(self._left)

    def link(self, role: Role) -> str | None:
        """The address for a role; None where there is none."""
        return self.door.link(self.port, role)

    def _no_tunnel(self, *_: object, **__: object) -> None:
        self.journal.tell("a public tunnel was asked for: refused", bad=True)

    # ---- browsers

    async def _came(self, client: Any) -> None:
        role = self.door.current_role()
        if role is None:
            return  # no page, no orders
        await asyncio.get_running_loop().run_in_executor(None, self._open, client, role)

    def _open(self, client: Any, role: Role) -> None:
        browser: int = client.client_id
        board = self.board
        # One at a time enters a container. The browser gets its page once it is whole: what is
        # pressed in it is answered from the first moment on.
        with self._building, client.atomic():
            page = Page(
                self.desk, client, role, now=board.now, signals=board.signals, timing=board.timing
            )
        self.journal.tell(f"browser {browser} is here, to {role}")
        with self._coming:
            if browser in self._gone:
                self._gone.remove(browser)
            else:
                self._pages[browser] = page

    async def _left(self, client: Any) -> None:
        # in threads that nothing else has: what it started ends, whatever is waited for elsewhere
        await asyncio.get_running_loop().run_in_executor(self._leaving, self._close, client)

    def _close(self, client: Any) -> None:
        browser: int = client.client_id
        with self._coming:
            if self._pages.pop(browser, None) is None:
                self._gone.add(browser)
        self.journal.tell(f"browser {browser} has left")
        self.desk.left(browser, "it has left: halted")

    # ---- the one loop that reads

    def run(self, seconds: float = math.inf) -> None:
        """Follow the kernel until ``stop``, or so many seconds."""
        until = time.monotonic() + seconds
        due = time.monotonic()
        due_for = dict.fromkeys(("plots", "texts", "times"), due)
        while not self._end.is_set() and time.monotonic() < until:
            feedback = self.watching.feedback()
            now = time.monotonic()
            try:
                if feedback is None:
                    self._again()
                else:
                    self._show(feedback, now, due_for)
            except RuntimeError as fault:  # of viser: the next frame is another one
                self.journal.tell(f"a frame is left out: {fault}", bad=True)
            due = max(due + 1.0 / FRAMES, time.monotonic())
            self._end.wait(due - time.monotonic())

    def _show(self, feedback: Feedback, now: float, due_for: dict[str, float]) -> None:
        """What is due: the arm always, plots, texts and histograms at their own rates."""
        with self.server.atomic():
            self.board.follow(feedback, self._preview(now))
        if now >= due_for["plots"]:
            due_for["plots"] = now + 1.0 / PLOTS
            self._draw()
        if now >= due_for["texts"]:
            due_for["texts"] = now + 1.0 / TEXTS
            self._tell(feedback)
        if now >= due_for["times"] and self._pages:
            due_for["times"] = now + 1.0
            self._each(lambda page: page.timing.show(feedback))

    def stop(self) -> None:
        """End ``run``."""
        self._end.set()

    def close(self) -> None:
        """Halt what the panel moves, and leave."""
        self._end.set()
        self.desk.close()
        self._stop_server()
        self._leaving.shutdown(wait=False)
        logging.getLogger("asyncio").removeFilter(self._noise)
        self.watching.close()

    def _stop_server(self) -> None:
        with _quiet():
            self.server.stop()

    def _again(self) -> None:
        """The kernel has ended: nobody leads, and it is looked for."""
        if self.watching.runs:
            self.journal.tell("the kernel has ended", bad=True)
            self._lead.lost()
            self.watching.lost()
            self.desk.proposal, self.desk.preview = None, False
            self.board.gone("the kernel has ended; it is looked for")
            self._each(lambda page: page.refresh())
        try:
            if self.watching.attach() is not None:
                self.journal.tell("a kernel runs again")
                self._each(lambda page: page.timing.restart())
        except SjerkError as fault:
            self.board.gone(str(fault))

    def _preview(self, now: float) -> Any:
        """Where the ghost is along the plan; None: at the goal."""
        proposal = self.desk.proposal
        if proposal is None or not self.desk.preview:
            return None
        plan = proposal.plan
        at = (now - proposal.made) % (plan.duration + 0.5)
        return plan.position[min(int(at / self.desk.cycle_time), len(plan.position) - 1)]

    def _draw(self) -> None:
        scope = self.watching.scope
        if scope is not None:
            self._each(lambda page: page.signals.draw(scope))

    def _tell(self, feedback: Feedback) -> None:
        self.journal.events(self.watching.events())
        if count := self._noise.taken():
            self.journal.tell("a browser sent what is no value: refused", bad=True, count=count)
        try:
            self.board.tell(feedback, seen=len(self._pages))
        except KernelGoneError:
            return
        self._each(_refreshed)

    def _each(self, work: Callable[[Page], None]) -> None:
        with self._coming:
            pages = list(self._pages.values())
        for page in pages:
            with suppress(RuntimeError):  # its browser has left meanwhile
                work(page)


class _Refused(logging.Filter):
    """What viser could not read of a browser is a line of the events, not pages in the terminal.

    It is told when a task is forgotten, in whatever thread that is and whatever lock that has: it
    is only counted here.
    """

    def __init__(self) -> None:
        super().__init__()
        self._count = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether it is of anything else."""
        if "_handle_incoming_message" not in record.getMessage():
            return True
        self._count += 1
        return False

    def taken(self) -> int:
        """How many since the last call."""
        count = self._count
        self._count -= count
        return count


def _quiet() -> contextlib.redirect_stdout[io.StringIO]:
    """Viser prints addresses without the secret, which nobody can open."""
    return contextlib.redirect_stdout(io.StringIO())


def _refreshed(page: Page) -> None:
    page.refresh()
    page.tick()
