"""Stops beside hosts that are killed at random: none lost, each in the next cycle.

Run it with ``./run stress stop [--stops N]``. A real kernel process, a host that moves its axes and
is killed with SIGKILL at random moments, one stopper that is killed in the same way, and two that
live: they ask for halts and quick stops of random axes at random moments and count how many cycles
later the kernel told of each, with their process. At the end the recording of all cycles runs again
in virtual time. Exit status 0 if nothing was lost, late, told of another process, or different.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import random
import signal
import sys
import time
from collections import Counter
from typing import Any

from sjerk import Axis, Host, Limits, Monitor, MotionKernel, Recorder, replay
from sjerk._binding import lib
from sjerk.errors import SjerkError
from sjerk.handshake import Segment
from sjerk.host import EventKind
from sjerk.host.reader import EventCursor, FrameReader

AXES = 3
PATIENT_S = 60.0  # a machine may be busy; a lost stop never comes
AXIS = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0, stop_limits=Limits(90.0, 2000.0, 4e4))


def lead(name: str, seed: int) -> None:
    """A host: moves and jogs at random until it is killed."""
    dice = random.Random(seed)
    with contextlib.suppress(SjerkError), Host.attach(name, wait=PATIENT_S) as host:
        host.enable()
        while True:
            if dice.random() < 0.5:
                host.move([dice.uniform(-170, 170) for _ in range(AXES)])
            else:
                host.jog([dice.uniform(-80, 80) for _ in range(AXES)])
            time.sleep(dice.uniform(0.0, 0.02))


def pester(name: str, seed: int) -> None:
    """A stopper without patience, until it is killed."""
    dice = random.Random(seed)
    with Segment.attach(name, role="stopper") as segment:
        while True:
            bits = dice.randrange(1, 1 << AXES)
            lib.sj_stop_request(segment.base, segment.stop_slot, bits, bits >> 1)
            time.sleep(dice.uniform(0.0, 0.005))


def ask(name: str, seed: int, count: int, answers: Any) -> None:
    """``count`` stops, one after the other; the cycles that each took, and how many never came."""
    dice = random.Random(seed)
    took: Counter[int] = Counter()
    lost = wrong = 0
    with Segment.attach(name, role="stopper") as segment:
        reader, cursor = FrameReader(segment), EventCursor(segment)
        reader.wait_until(lambda frame: True, PATIENT_S, "the first cycle")
        for _ in range(count):
            bits, halt = dice.randrange(1, 1 << AXES), dice.random() < 0.5
            before = int(reader.frame().cycle)
            lib.sj_stop_request(
                segment.base, segment.stop_slot, bits if halt else 0, 0 if halt else bits
            )
            after = int(reader.frame().cycle)
            told: list[int] = []
            cycle, end = 0, time.monotonic() + PATIENT_S
            wanted = {-1} if bits == (1 << AXES) - 1 else {i for i in range(AXES) if bits >> i & 1}
            while len(told) < len(wanted) and time.monotonic() < end:
                event = cursor.next()
                if event is None:
                    time.sleep(2e-4)
                elif event.kind == EventKind.STOP and int(event.value) == os.getpid():
                    told.append(int(event.axis))
                    cycle = int(event.cycle)
            if len(told) < len(wanted):
                lost += 1
                continue
            # the frame of the cycle that took it comes after `before`; where `after` was read, the
            # cycle behind that one may have looked already
            wrong += set(told) != wanted or not before < cycle <= after + 2
            took[cycle - after] += 1
            time.sleep(dice.uniform(0.0, 0.003))
    answers.put((lost, wrong, took))


def main() -> int:
    """Run until every stop has been asked for; print what became of them."""
    parser = argparse.ArgumentParser(prog="./run stress stop", description=__doc__)
    parser.add_argument("--stops", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=time.time_ns() % 2**32)
    options = parser.parse_args()
    dice = random.Random(options.seed)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["sjerk", "sjerk.host"])
    kills: Counter[str] = Counter()
    mortal: dict[str, Any] = {}
    with MotionKernel([AXIS] * AXES, 1e-3) as kernel, Recorder(kernel.name, None) as recorder:
        answers = context.Queue()
        halves = (options.stops - options.stops // 2, options.stops // 2)
        askers = [
            context.Process(target=ask, args=(kernel.name, options.seed + i, n, answers))
            for i, n in enumerate(halves)
        ]
        for process in askers:
            process.start()
        jobs = {"host": lead, "stopper": pester}
        while any(process.is_alive() for process in askers) and answers.empty():
            for who, job in jobs.items():
                if who not in mortal:
                    mortal[who] = context.Process(
                        target=job, args=(kernel.name, dice.getrandbits(32))
                    )
                    mortal[who].start()
            time.sleep(dice.uniform(0.02, 0.2))
            who = dice.choice(list(jobs))
            os.kill(mortal[who].pid, signal.SIGKILL)
            mortal.pop(who).join()
            kills[who] += 1
        results = [answers.get(timeout=10 * PATIENT_S) for _ in askers]
        for process in (*askers, *mortal.values()):
            if process in mortal.values():
                os.kill(process.pid, signal.SIGKILL)
            process.join()
        with Monitor.attach(kernel.name) as monitor:
            monitor.halt()
            rest = not monitor.feedback().moving
    lost, wrong = sum(one[0] for one in results), sum(one[1] for one in results)
    took: Counter[int] = sum((one[2] for one in results), Counter())
    again = replay(recorder.recording)
    print(f"seed {options.seed}; stops {options.stops}, lost {lost}, late or told wrong {wrong}")
    print(f"kills of the host {kills['host']}, of a stopper {kills['stopper']}")
    print("cycles from the newest frame when it was asked to the one that took it:")
    print("  " + ", ".join(f"{n}: {took[n]}" for n in sorted(took)))
    print(f"cycles {recorder.cycles}, missed {recorder.missed}, the same again: {again.identical}")
    good = lost == wrong == recorder.missed == 0 and again.identical and rest
    return 0 if good and sum(took.values()) == options.stops and min(kills.values()) > 0 else 1


if __name__ == "__main__":
    sys.exit(main())
