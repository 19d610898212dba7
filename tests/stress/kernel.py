"""Soak of the motion kernel: 16 axes, random commands from three hosts in turn, kills, faults.

Among the commands are homing, moves onto limit switches and forks of the host; two processes beside
the hosts stop axes; the director forks children that hold all it has open. Some axes are fed
forward: each of their words is judged.

Run it with ``./run stress kernel [--minutes N]``. It goes in rounds: a real kernel process with a
recorder from its first cycle to its last; three host processes that take turns and command at
random; the one in charge is killed with SIGKILL at random moments. Some axes have drives that
cannot follow what is asked and fault. A round ends in order, by SIGTERM or by SIGKILL of the
kernel. Meanwhile another process judges the recordings of the rounds before (kernel_check.py) and
replays each in virtual time, bit for bit. Exit status 0 if nothing was found.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from kernel_check import Verdict, check
from kernel_host import linger, pester, play

from sjerk import Axis, DriveConfig, Limits, MotionKernel, Recorder, Recording, replay
from sjerk._binding import lib
from sjerk.recording import files

COUNTS = 2**24 / 360.0
AXES = 16
#: Numbers of a verdict that are summed up.
COUNTED = (
    *("cycles", "gaps", "missed", "commands", "faults", "anchors", "late", "deaths"),
    *("homings", "switches", "stops", "fed"),
)
MEMORY_KB = 512  # what the kernel's own memory may grow by after its begin
# Imported once by the server that forks the others, so that a restart costs a fork.
PRELOAD = ["sjerk", "kernel_host", "kernel_check", "sjerk.recording.files"]


def axes() -> list[Axis]:
    """Sixteen axes of four kinds; the last two have drives that fault when they are driven hard."""
    plain = Limits(90.0, 500.0, 5000.0, deceleration=300.0, position=(-170.0, 170.0))
    quick = Limits(90.0, 2000.0, 40000.0)
    fast = Limits(180.0, 1500.0, 30000.0)
    slow = Limits(20.0, 60.0, 400.0, position=(-50.0, 50.0))
    lagging = DriveConfig(
        velocity_feedforward=0.5, following_window=round(0.8 * COUNTS), following_time_ms=20
    )
    switched = DriveConfig(switch_negative_rev=-0.12, switch_positive_rev=0.1)
    made = [Axis(plain, COUNTS, unit="deg", stop_limits=quick) for _ in range(2)]
    made += [Axis(plain, COUNTS, feed_forward="torque", stop_limits=quick) for _ in range(2)]
    made += [Axis(plain, COUNTS, switched, unit="deg", stop_limits=quick) for _ in range(2)]
    made += [Axis(fast, COUNTS, unit="deg", wrap=360.0) for _ in range(3)]
    made += [Axis(fast, COUNTS, unit="deg", wrap=360.0, feed_forward="velocity")]
    made += [Axis(slow, COUNTS, unit="deg") for _ in range(2)]
    made += [Axis(plain, COUNTS, "ideal", unit="deg", stop_limits=quick) for _ in range(2)]
    made += [
        Axis(plain, COUNTS, lagging, unit="deg", stop_limits=quick),
        Axis(plain, COUNTS, DriveConfig(velocity_feedforward=0.5), following_error=0.8),
    ]
    assert len(made) == AXES
    return made


# ---- the judge -----------------------------------------------------------------------------------


def judge(path: str, answer: str) -> None:
    """In a process of its own: the recording of a round, judged and replayed."""
    recording = Recording.open(path)
    verdict = check(recording)
    told = {"speed": 0.0}
    if recording.gaps:
        told["replayed"] = 0
    else:
        done = replay(recording)
        told |= {"speed": done.speed, "replayed": done.cycles}
        if not done.identical:
            verdict.find("replay", str(done.difference))
    Path(answer).write_text(json.dumps(told | vars(verdict)))


def log_findings(log: Path, verdict: Verdict, acts: Counter[str]) -> None:
    """What the hosts saw: a command without an answer is a finding; so is a goal's odd end."""
    for line in log.read_text().splitlines() if log.exists() else ():
        with contextlib.suppress(json.JSONDecodeError):  # the last line of a killed host
            entry = json.loads(line)
            for kind in ("unanswered", "failed"):
                if kind in entry:
                    verdict.find(f"host: {kind}", str(entry[kind]))
            if "did" in entry:
                acts[entry["did"]] += 1
            if "goal" in entry:
                acts["answers"] += 1


# ---- the director --------------------------------------------------------------------------------


class Soak:
    """Rounds, and what they gave."""

    def __init__(self, folder: Path, seconds: float, seed: int) -> None:
        self.folder, self.seed = folder, seed
        self.until = time.monotonic() + seconds
        self.random = random.Random(seed)
        self.context = multiprocessing.get_context("forkserver")
        self.context.set_forkserver_preload(PRELOAD)
        self.total = Verdict()
        self.acts: Counter[str] = Counter()
        self.kills = self.rounds = self.replayed = self.forks = 0
        self.memory: list[tuple[int, int]] = []
        self.judging: list[tuple[Any, Path, Path]] = []
        self.ends: Counter[str] = Counter()
        self.speed = 0.0

    def say(self, text: str) -> None:
        left = max(0.0, self.until - time.monotonic())
        print(f"soak: {text}; {left:.0f} s left", file=sys.stderr, flush=True)

    def host(self, name: str, log: Path) -> Any:
        child = self.context.Process(
            target=play, args=(name, self.random.randrange(2**32), str(log)), daemon=True
        )
        child.start()
        return child

    def stopper(self, name: str, log: Path) -> Any:
        child = self.context.Process(
            target=pester, args=(name, self.random.randrange(2**32), str(log)), daemon=True
        )
        child.start()
        return child

    def fork(self) -> None:
        """A child that holds the pipes of the kernel, mostly longer than the round lasts."""
        self.forks += 1
        linger(self.random.uniform(0.5, 20.0))

    def round(self, seconds: float) -> None:
        self.rounds += 1
        name = f"soak-{os.getpid()}-{self.rounds}"
        path, log = self.folder / f"{self.rounds}.parquet", self.folder / f"{self.rounds}.log"
        end = self.random.choice(["in order", "SIGTERM", "SIGKILL"])
        self.ends[end] += 1
        files.ready(path)
        kernel = MotionKernel(axes(), 1e-3, name=name)
        with contextlib.ExitStack() as recorded, kernel:
            recorder = recorded.enter_context(Recorder(name, path))
            self.play(kernel, log, seconds)
            pid = kernel.pid or 0
            if end != "in order":
                os.kill(pid, signal.SIGKILL if end == "SIGKILL" else signal.SIGTERM)
                self.gone(kernel)
        for child in self.hosts + self.stoppers:
            child.join(30.0)
            if child.is_alive():
                self.total.find("client did not end", str(child))
                child.kill()
                child.join()
        self.say(f"round {self.rounds}: {recorder.cycles} cycles, ended {end}")
        answer = self.folder / f"{self.rounds}.json"
        process = self.context.Process(target=judge, args=(str(path), str(answer)), daemon=True)
        process.start()
        self.judging.append((process, path, answer))
        log_findings(log, self.total, self.acts)

    def gone(self, kernel: MotionKernel) -> None:
        end = time.monotonic() + 60.0
        while kernel.alive:
            if time.monotonic() > end:
                self.total.find("kernel did not end", kernel.name)
                return
            time.sleep(0.01)

    def play(self, kernel: MotionKernel, log: Path, seconds: float) -> None:
        """Three hosts; kills of whichever is in charge; the kernel's memory."""
        self.hosts = [self.host(kernel.name, log) for _ in range(3)]
        self.stoppers = [self.stopper(kernel.name, log) for _ in range(2)]
        end = min(time.monotonic() + seconds, max(self.until, time.monotonic() + 2.0))
        begun = time.monotonic()
        first = last = 0
        kill = time.monotonic() + self.random.uniform(1.0, 3.0)
        while time.monotonic() < end:
            time.sleep(0.05)
            if not kernel.alive:
                self.total.find("kernel died", kernel.name)
                return
            if self.random.random() < 0.01:
                self.fork()
            if time.monotonic() > begun + 1.0:
                last = own_memory(kernel.pid or 0)
                first = first or last
            if time.monotonic() > kill:
                kill = time.monotonic() + self.random.uniform(0.5, 4.0)
                assert kernel._segment is not None
                self.kill_one(kernel.name, log, lib.sj_shm_host_pid(kernel._segment.base))
        self.memory.append((first, last))
        if last - first > MEMORY_KB:
            self.total.find("memory", f"{first} kB to {last} kB in {seconds:.0f} s")

    def kill_one(self, name: str, log: Path, in_charge: int) -> None:
        """Mostly the one that is host now."""
        victim = self.random.choice(self.hosts)
        if self.random.random() < 0.8:
            victim = next((h for h in self.hosts if h.pid == in_charge), victim)
        if victim.is_alive():
            victim.kill()
            self.kills += 1
        victim.join()
        self.hosts.remove(victim)
        self.hosts.append(self.host(name, log))

    def collect(self, *, all_of_them: bool) -> None:
        """Verdicts of the judges that are done."""
        for entry in list(self.judging):
            process, path, answer = entry
            if process.is_alive() and not all_of_them:
                continue
            process.join()
            self.judging.remove(entry)
            if not answer.exists():
                self.total.find("judge failed", f"{path.name}, exit code {process.exitcode}")
                continue
            self.add(json.loads(answer.read_text()), path)

    def add(self, told: dict[str, Any], path: Path) -> None:
        total = self.total
        for name in COUNTED:
            setattr(total, name, getattr(total, name) + told[name])
        total.goals.update(told["goals"])
        total.findings.update(told["findings"])
        total.words += [f"{path.stem}: {word}" for word in told["words"]]
        for name, value in told["largest"].items():
            total.largest[name] = max(total.largest.get(name, 0.0), value)
        self.replayed += told["replayed"]
        self.speed = told["speed"] or self.speed
        if not told["findings"]:
            path.unlink()

    def run(self) -> None:
        longest = max(3.0, min(25.0, (self.until - time.monotonic()) / 3))
        while time.monotonic() < self.until:
            self.round(self.random.uniform(0.5, 1.0) * longest)
            self.collect(all_of_them=len(self.judging) > 2)
        self.collect(all_of_them=True)


def own_memory(pid: int) -> int:
    """Memory of a process that is its own, kB; 0 where it has just ended."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("RssAnon"):
                return int(line.split()[1])
    return 0


def table(soak: Soak) -> str:
    """What was done and found."""
    total = soak.total
    grown = max((last - first for first, last in soak.memory), default=0)
    largest = ", ".join(f"{name} {share:.9f}" for name, share in total.largest.items())
    acts = ", ".join(f"{name} {count}" for name, count in sorted(soak.acts.items()))
    ends = ", ".join(f"{name} {count}" for name, count in sorted(soak.ends.items()))
    lines = [
        f"seed                     {soak.seed}",
        f"rounds                   {soak.rounds} ({ends})",
        f"cycles x axes            {total.cycles:,} x {AXES}",
        f"  skipped by the clock   {total.late:,} (told by events)",
        f"gaps in recordings       {total.gaps} ({total.missed} items)",
        f"commands taken           {total.commands:,} ({acts})",
        f"goals                    {dict(total.goals)}",
        f"hosts killed             {soak.kills} (seen in charge by the kernel: {total.deaths})",
        f"drive faults, anchors    {total.faults}, {total.anchors}",
        f"homings, limit switches  {total.homings}, {total.switches}",
        f"stops from beside        {total.stops}",
        f"forked children          {soak.forks} of the director, {soak.acts['fork']} of hosts",
        f"words fed forward        {total.fed:,}",
        f"largest share of limits  {largest}",
        f"replayed bit for bit     {soak.replayed:,} cycles ({soak.speed:.0f} times real time)",
        f"memory of the kernel     grew by {grown} kB at most in a round",
        f"findings                 {sum(total.findings.values())} {dict(total.findings)}",
    ]
    return "\n".join(lines + [f"  {word}" for word in total.words])


def main() -> int:
    """Run the rounds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=random.randrange(10**6))
    parser.add_argument("--keep", type=Path, help="a folder for the recordings with findings")
    arguments = parser.parse_args()
    if not arguments.minutes > 0:
        parser.error(f"--minutes {arguments.minutes} must be > 0")
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="sjerk-soak-") as scratch:
        folder = arguments.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        soak = Soak(folder, 60.0 * arguments.minutes, arguments.seed)
        try:
            soak.run()
        except KeyboardInterrupt:
            soak.total.find("interrupted", f"after {time.monotonic() - begun:.0f} s")
        finally:
            for child in multiprocessing.active_children():
                child.kill()
                child.join()
    left = [p.name for p in Path("/dev/shm").glob(f"sjerk-soak-{os.getpid()}-*")]
    if left:
        soak.total.find("segments left", str(left))
    print(table(soak))
    print(f"segments left {len(left)}; took {time.monotonic() - begun:.0f} s")
    return 1 if soak.total.findings else 0


if __name__ == "__main__":
    sys.exit(main())
