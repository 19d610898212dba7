"""A host of a soak: commands of every kind at random, until its kernel ends or it is killed.

Waits for each answer and writes what became of each goal, so that one without is found.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import threading
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from sjerk import (
    Host,
    InputError,
    KernelGoneError,
    Limits,
    Monitor,
    RefusedError,
    follow_path,
)
from sjerk.errors import HandshakeError, HostTakenError, SegmentMissingError
from sjerk.host import MoveState, PathState
from sjerk.profile import State

ANSWER_S = 20.0  # longest wait for an answer: a loaded machine is slow, a lost one never comes


class Client:
    """One turn of one host."""

    def __init__(self, host: Host, rng: random.Random, log: Path) -> None:
        self.host, self.rng, self.log = host, rng, log
        self.moves: list[Any] = []
        self.limits = list(host.limits)
        self.axes = len(self.limits)

    def write(self, **what: Any) -> None:
        with self.log.open("a") as file:
            file.write(json.dumps(what) + "\n")

    # ---- what a host can do

    def some(self) -> list[int]:
        return self.rng.sample(range(self.axes), self.rng.choice([1, 1, 2, 4, self.axes]))

    def goal(self, i: int) -> float:
        low, high = self.limits[i].position or (-300.0, 300.0)
        return self.rng.uniform(low, high)

    def lower(self, chosen: list[int]) -> Limits | None:
        if self.rng.random() < 0.5:
            return None
        part = [self.rng.uniform(0.1, 1.0) for _ in range(3)]
        own = [self.host.limits[i] for i in chosen]
        return Limits(
            part[0] * min(x.velocity for x in own),
            part[1] * min(min(x.acceleration, x.braking[0]) for x in own),
            part[2] * min(min(x.jerk, x.braking[1]) for x in own),
        )

    def move(self) -> None:
        chosen = self.some()
        limits = self.lower(chosen)
        kind = self.rng.choice(["time", "time", "phase", "none"])
        ask: dict[int, Any] = {i: self.goal(i) for i in chosen}
        if kind != "phase" and self.rng.random() < 0.2:
            fast = limits or self.host.limits[chosen[0]]
            ask[chosen[0]] = State(ask[chosen[0]], self.rng.uniform(-1, 1) * fast.velocity)
        self.moves.append(self.host.move(ask, limits=limits, synchronization=kind))  # type: ignore[arg-type]

    def relative(self) -> None:
        ask: dict[int, Any] = {i: self.rng.uniform(-20.0, 20.0) for i in self.some()}
        self.moves.append(self.host.move(ask, relative=True))

    def jog(self) -> None:
        ask = {i: self.rng.uniform(-1, 1) * self.host.limits[i].velocity for i in self.some()}
        self.moves.append(self.host.jog(ask))

    def fast_jog(self) -> None:
        """What the drives of some axes cannot follow: they fault."""
        i = self.axes - 1 - self.rng.randrange(2)
        sign = self.rng.choice([-1.0, 1.0])
        self.moves.append(self.host.jog({i: sign * self.host.limits[i].velocity}))

    def queue(self) -> None:
        """Moves that wait for each other, or blend into one another."""
        chosen = self.some()
        for _ in range(self.rng.randrange(1, 6)):
            kind = self.rng.choice(
                ["buffered", "blend low", "blend previous", "blend next", "blend high"]
            )
            ask: dict[int, Any] = {i: self.goal(i) for i in chosen}
            self.moves.append(
                self.host.move(ask, limits=self.lower(chosen), buffer=kind)  # type: ignore[arg-type]
            )

    def path(self) -> None:
        """A short path from where its axes rest; sometimes at another speed."""
        chosen = sorted(self.some()[:4])
        frame = self.host.feedback()
        if any(frame.axes[i].moving for i in chosen):
            return
        begin = np.array([frame.axes[i].position for i in chosen])
        way = np.cumsum([[self.rng.uniform(-2.0, 2.0) for _ in chosen] for _ in range(3)], axis=0)
        rows = np.vstack([begin, begin + way])
        plan = follow_path(rows, [self.host.limits[i] for i in chosen], self.host.cycle_time)
        path = self.host.follow(plan, axes=chosen)
        self.moves.append(path)
        if self.rng.random() < 0.5:
            path.speed(self.rng.uniform(0.2, 1.5))

    def cancel(self) -> None:
        if self.moves:
            self.rng.choice(self.moves).cancel()

    def halt(self) -> None:
        self.host.halt(0.0, axes=self.some())

    def quick_stop(self) -> None:
        self.host.quick_stop(0.0, axes=self.some())

    def override(self) -> None:
        self.host.override(self.rng.choice([0.0, 0.1, 0.5, 1.0, 1.0, 1.0, 1.7, 2.0]), ANSWER_S)

    def hold(self) -> None:
        self.host.hold(ANSWER_S)

    def resume(self) -> None:
        self.host.resume(ANSWER_S)

    def change(self) -> None:
        for i in self.some():
            own = self.limits[i]
            part = self.rng.uniform(0.3, 1.0)
            new = Limits(own.velocity * part, own.acceleration * part, own.jerk * part)
            self.host.set_limits(new, axes=i, timeout=ANSWER_S)

    def home(self) -> None:
        """Where the axes are, by method 37, some at a time."""
        self.moves.append(self.host.home(axes=self.some()))

    def onto_a_switch(self) -> None:
        """The axes that have limit switches, as far as their limits allow, which is beyond."""
        i = self.rng.choice([4, 5])
        self.moves.append(self.host.jog({i: self.rng.choice([-80.0, 80.0])}))

    def fork(self) -> None:
        """A child that holds all that the host has open, also when the host is killed."""
        linger(self.rng.uniform(0.1, 5.0))

    def disable(self) -> None:
        self.host.disable(0.0, axes=self.rng.randrange(self.axes))

    def enable(self) -> None:
        self.host.reset(timeout=ANSWER_S)
        self.host.enable(0.0)

    # ---- one turn

    def turn(self, seconds: float) -> None:
        acts = [self.move] * 8 + [self.relative] * 2 + [self.jog] * 4 + [self.queue] * 4
        acts += [self.path] * 4
        acts += [self.halt, self.quick_stop, self.override, self.hold, self.change, self.disable]
        acts += [self.home] * 2 + [self.onto_a_switch] * 2 + [self.fork]
        acts += [self.resume] * 4 + [self.enable] * 3 + [self.cancel] + [self.fast_jog]
        end = time.monotonic() + seconds
        self.attempt(self.enable)
        while time.monotonic() < end:
            self.attempt(self.rng.choice(acts))
            self.look()
            if self.rng.random() < 0.7:
                time.sleep(self.rng.expovariate(1 / 0.03))
        self.answered()

    def attempt(self, act: Any) -> None:
        """A command. What cannot be asked is not sent; a stop's rest is not waited for."""
        try:
            act()
        except (InputError, RefusedError):
            self.write(did=act.__name__, refused=True)
            return
        except TimeoutError:
            pass
        self.write(did=act.__name__)
        sequence = int(self.host.link.command.sequence)
        try:
            self.host.link.wait_until(lambda f: f.sequence >= sequence, ANSWER_S, act.__name__)
        except TimeoutError as fault:
            self.write(unanswered=str(fault))

    def look(self) -> None:
        """Goals that have an answer now."""
        left = []
        for move in self.moves:
            state = move.state
            if state in (MoveState.SENT, PathState.SENT):
                left.append(move)
                continue
            self.write(goal=getattr(move, "goal_id", 0) or move.goal_id, state=str(state.name))
        self.moves = left[-64:]

    def answered(self) -> None:
        """Every direct goal has an answer before this host leaves."""
        end = time.monotonic() + ANSWER_S
        while [m for m in self.moves if not getattr(m, "queued", False)]:
            self.look()
            if time.monotonic() > end:
                for move in self.moves:
                    self.write(unanswered=f"goal {move.goal_id}")
                return
            time.sleep(1e-3)


def linger(seconds: float) -> None:
    """Fork a child that sleeps and leaves, with everything that its parent has open."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads: the child needs none
        child = os.fork()
    if child == 0:
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        time.sleep(seconds)
        os._exit(0)
    threading.Thread(target=os.waitpid, args=(child, 0), daemon=True).start()


def pester(name: str, seed: int, log: str) -> None:
    """Beside the hosts: stop some axes at random, until the kernel has ended."""
    rng = random.Random(seed)
    try:
        with Monitor.attach(name) as monitor:
            axes = len(monitor.feedback().axes)
            while True:
                time.sleep(rng.expovariate(1 / 0.5))
                chosen = rng.sample(range(axes), rng.choice([1, 2, axes]))
                stop = rng.choice([monitor.halt, monitor.quick_stop])
                with contextlib.suppress(TimeoutError):
                    stop(rng.choice([0.0, ANSWER_S]), axes=chosen)
    except (KernelGoneError, HandshakeError, TimeoutError):
        return
    except Exception as fault:
        with Path(log).open("a") as file:
            file.write(json.dumps({"failed": repr(fault)}) + "\n")


def play(name: str, seed: int, log: str) -> None:
    """Be one of the hosts, again and again, until the kernel has ended."""
    rng = random.Random(seed)
    while True:
        try:
            host = Host.attach(name, wait=0.2)
        except HostTakenError:
            time.sleep(rng.uniform(0.0, 0.2))
            continue
        except (SegmentMissingError, KernelGoneError, TimeoutError):
            return
        client = Client(host, rng, Path(log))
        try:
            client.turn(rng.uniform(0.3, 3.0))
            if rng.random() < 0.3:
                client.attempt(client.halt)
            host.close()
        except (KernelGoneError, HandshakeError):
            return
        except Exception as fault:  # a host that fails is a finding, whatever made it fail
            client.write(failed="".join(traceback.format_exception(fault)[-3:]))
            return
        time.sleep(rng.uniform(0.0, 0.3))
