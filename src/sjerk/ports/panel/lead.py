"""Who leads: the role of the host, taken only when a browser asks, and given back at once.

One browser leads. While a button is held, its messages are the beats of the host; without them the
panel halts after ``holding.LIMIT``, and should the panel hang too, the kernel halts by itself after
``WATCH``. What a browser started does not outlive it. Never here: pages, plans.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

from sjerk.errors import HostTakenError, InputError, SjerkError
from sjerk.host import Blocks, Host, Path
from sjerk.ports.panel.holding import Holds, Press
from sjerk.ports.panel.watching import Watching

#: Seconds without a beat after which the kernel halts by itself.
WATCH = 0.5
_LOOK = 0.02
#: A second press of STOP within so many seconds is a quick stop.
_AGAIN = 2.0
_RUN = "run"


class NotLeadingError(SjerkError):
    """An order of a browser that does not lead, or cannot."""


class Lead:
    """The lead over the kernel that ``watching`` sees; browsers by number.

    ``tell`` gets what becomes of it, in words.
    """

    def __init__(
        self, watching: Watching, tell: Callable[[str], None], *, any_owner: bool = False
    ) -> None:
        self._watching, self._tell, self._any_owner = watching, tell, any_owner
        self._lock = threading.RLock()
        self._browser: int | None = None
        self._host: Host | None = None
        self._path: Path | None = None
        self._holds = Holds()
        self._stopped = -_AGAIN
        self._stops = 0
        self._users: list[Callable[[], None]] = []
        self._then: Callable[[str], None] | None = None
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="dead-man", daemon=True)
        self._thread.start()

    # ---- the role

    @property
    def browser(self) -> int | None:
        """The one that leads; None: nobody."""
        return self._browser

    @property
    def path(self) -> Path | None:
        """The path that was executed last."""
        return self._path

    @property
    def stops(self) -> int:
        """How many stops there were; whoever commands by itself ends with the next one."""
        return self._stops

    def take(self, browser: int) -> None:
        """Become the leader; raises NotLeadingError with who is it."""
        with self._lock:
            if self._browser == browser:
                return
            if self._browser is not None:
                raise NotLeadingError(f"browser {self._browser} leads")
            name = self._watching.name
            try:
                host = Host.attach(name, wait=0.2, any_owner=self._any_owner)
            except HostTakenError as taken:
                raise NotLeadingError(f"process {taken.pid} leads") from taken
            host.watch(WATCH)
            self._host, self._browser = host, browser
        self._tell(f"browser {browser} leads")

    def of(self, browser: int) -> Host:
        """The host for the browser that leads; all others are refused here."""
        host = self._host
        if self._browser != browser or host is None:
            raise NotLeadingError("this browser does not lead: take the lead first")
        return host

    def give_back(self, browser: int, why: str) -> None:
        """Halt what it moves, then leave; nothing where it does not lead."""
        with self._lock:
            if self._browser != browser:
                return
            self._leave()
        self._tell(f"browser {browser} leads no longer: {why}")

    def lost(self) -> None:
        """The kernel is gone: nobody leads."""
        with self._lock:
            browser = self._browser
            self._leave()
        if browser is not None:
            self._tell(f"browser {browser} leads no longer: the kernel has ended")

    def _leave(self) -> None:
        host, self._host, self._browser = self._host, None, None
        self._holds.clear(time.monotonic())
        self._stops += 1
        if host is None:
            return
        self._halt(host)
        users, self._users = self._users, []
        with ExitStack() as leaving:  # whatever one of these raises, the host is closed
            leaving.enter_context(suppress(SjerkError, OSError))
            leaving.callback(host.close)
            leaving.enter_context(suppress(SjerkError, OSError))
            leaving.callback(host.watch, None)
            for end in users:  # nobody else may use the host when it is closed
                end()
            if users:  # one may have begun a motion beside the stop
                self._halt(host)
            self._look_at_path("the lead is given back")
            self._path = None

    def _halt(self, host: Host) -> None:
        with suppress(SjerkError, OSError):
            self._watching.stop(quick=False)  # the kernel takes it though this host leaves
        with suppress(SjerkError, OSError):
            host.halt(timeout=0.0)

    # ---- stopping: any browser may, and whoever leads

    def stop(self) -> str:
        """Halt all axes; again within 2 s: the quick stop. Waits for nothing, asks nothing.

        Not even for the lock: whoever has it, and commands something beside this stop, finds
        ``stops`` changed and halts again. ``let_all_go`` is to be called next.
        """
        now = time.monotonic()
        quick = now - self._stopped < _AGAIN
        self._stopped = now
        self._stops += 1  # first
        self._watching.stop(quick=quick)
        return "quick stop" if quick else "halt"

    def let_all_go(self) -> None:
        """After a stop: every held button needs a fresh press; a jog that began beside it ends."""
        with self._lock:
            held = self._holds.any
            self._holds.clear(time.monotonic())
            if held:
                self._watching.stop(quick=False)

    def check_stops(self, stops: int | None) -> None:
        """Raise NotLeadingError where a stop was asked for since there were so many."""
        if stops is not None and stops != self._stops:
            raise NotLeadingError("a stop came in between: order it again")

    @contextmanager
    def _unless_stopped(self, host: Host, stops: int | None) -> Iterator[None]:
        """What is commanded within is halted where a stop came beside it; raises then."""
        before = self._stops if stops is None else stops
        self.check_stops(before)
        yield
        if self._stops != before:
            host.halt(timeout=0.0)
            self.check_stops(before)

    # ---- orders

    def jog(self, browser: int, axis: int, velocity: float) -> None:
        """One message of a held jog button; the first one begins."""
        with self._lock:
            host = self.of(browser)
            press = self._holds.message(axis, time.monotonic())
            if press is Press.CUT:
                return
            if press is Press.BEGINS:
                try:
                    with self._unless_stopped(host, None):
                        host.jog({axis: velocity})
                except SjerkError:
                    self._holds.cut(axis, time.monotonic())
                    raise
            host.beat()

    def release(self, browser: int, axis: int) -> None:
        """A jog button was let go."""
        with self._lock:
            if self._holds.release(axis) and self._browser == browser and self._host is not None:
                self._host.halt(timeout=0.0, axes=[axis])

    def order(
        self, browser: int, work: Callable[[Host], object], *, stops: int | None = None
    ) -> None:
        """An order of the browser that leads; ``work`` may not wait: the dead-man's switch does.

        ``stops``: how many there were when it was given; with one more it is refused.
        """
        with self._lock:
            host = self.of(browser)
            with self._unless_stopped(host, stops):
                work(host)

    def reset(self, browser: int) -> None:
        """Ask for a reset of faults, and wait for nothing."""

        def ask(host: Host) -> None:
            with suppress(TimeoutError):
                host.reset(timeout=1e-6)

        self.order(browser, ask)

    def use(self, end: Callable[[], None]) -> None:
        """Call this before the host is closed: whoever uses it in a thread ends there."""
        with self._lock:
            self._users.append(end)

    def play(
        self,
        browser: int,
        blocks: Blocks,
        *,
        speed: float = 1.0,
        hold: bool = False,
        then: Callable[[str], None] | None = None,
        stops: int | None = None,
    ) -> Path:
        """Execute a path; ``hold``: only while its button is held.

        ``then`` is called once it is over: with "" at its end, else with the reason. ``stops`` as
        of ``order``.
        """
        with self._lock:
            host = self.of(browser)
            if self._holds.others(_RUN):
                raise NotLeadingError("a jog button is held")
            self._look_at_path("another path is executed")
            with self._unless_stopped(host, stops):
                path = host.follow(blocks)
            self._path, self._then = path, then
            if speed != 1.0:
                path.speed(speed)
            if hold:
                self._holds.message(_RUN, time.monotonic())
            return path

    def keep(self, browser: int) -> Press:
        """One message of the held button of a path; the first one of a press goes on."""
        with self._lock:
            host = self.of(browser)
            press = self._holds.message(_RUN, time.monotonic())
            if press is not Press.CUT:
                host.beat()
            path = self._path
            if press is Press.BEGINS and path is not None and path.paused and not path.state.ended:
                with self._unless_stopped(host, None):
                    path.resume()
            return press

    def refuse(self, browser: int) -> None:
        """What the button of a path asked for was refused: it needs a fresh press."""
        with self._lock:
            if self._browser == browser:
                self._holds.cut(_RUN, time.monotonic())

    def let_go(self, browser: int) -> None:
        """The button of a path was let go: it comes to rest on the path."""
        with self._lock:
            if self._holds.release(_RUN) and self._browser == browser:
                self._pause()

    def speed(self, browser: int, factor: float) -> None:
        """Of the path in play, 0 .. 2; raises InputError."""
        with self._lock:
            self.of(browser)
            if not 0.0 <= factor <= 2.0:
                raise InputError("speed", factor, "must be 0 .. 2")
            if self._path is not None and not self._path.state.ended:
                self._path.speed(factor)

    def _pause(self) -> None:
        path = self._path
        if path is not None and not path.state.ended and not path.paused:
            path.pause()

    def _look_at_path(self, why: str = "") -> None:
        """Tell once what has become of the path; ``why``: it is not waited for any longer."""
        path, then = self._path, self._then
        if path is None or then is None:
            return
        if not why and not path.state.ended:
            return
        self._then = None
        try:
            path.check()
        except (SjerkError, OSError) as fault:
            why = str(fault)
        then("" if path.done else why)

    # ---- the dead-man's switch

    def _watch(self) -> None:
        while not self._end.wait(_LOOK):
            with self._lock, suppress(SjerkError, OSError):
                host = self._host
                if host is None:
                    continue
                for key in self._holds.expired(time.monotonic()):
                    if isinstance(key, int):
                        host.halt(timeout=0.0, axes=[key])
                        self._tell(f"axis {key}: the held button gave no sign, halted")
                    else:
                        self._pause()
                        self._tell("the held button gave no sign: at rest on the path")
                self._look_at_path()
                if not self._holds.any:
                    host.beat()  # nothing is held: this process' own life is enough

    def close(self) -> None:
        """End: halt what is moved, and leave."""
        self._end.set()
        self._thread.join()
        if self._browser is not None:
            self.give_back(self._browser, "the panel ends")
