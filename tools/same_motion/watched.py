"""Scripts in which drives say something: homing, faults, lost links, stale images."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from random import Random
from typing import Any

from adapter import inject, reactions
from commanded import Hand
from drawn import PERIODS, UNITS, WAITS, axis
from sjerk import Drive, DriveConfig, Host, MotionKernel, cia402
from told import Told, run

#: The older checkout calls the faults of a drive ``Fault``.
_Fault = getattr(cia402, "DriveFault", None) or cia402.Fault
_INJECTED = [fault for fault in _Fault if fault <= _Fault.LOST_LINK]


# ---- homing --------------------------------------------------------------------------------------


def homing_config(draw: Random) -> dict[str, Any]:
    """Fields of a drive that can home by a method, mostly."""
    rev = 16777216
    ends = draw.random() < 0.8
    return {
        "homing_method": draw.choice([0, 17, 18, 33, 34, 35, 37]),
        "switch_negative_rev": draw.uniform(-0.6, -0.01) if ends else -1e9,
        "switch_positive_rev": draw.uniform(0.01, 0.6) if ends else 1e9,
        "homing_speed_switch": int(rev * draw.uniform(0.5, 5.0)),
        "homing_speed_zero": int(rev * draw.uniform(0.2, 2.0)),
        "homing_acceleration": int(rev * draw.uniform(1.0, 50.0)),
        "home_offset": draw.choice([0, draw.randint(-rev, rev)]),
        "polarity": draw.choice([0, 0, 0x80]),
        "halt_option": draw.choice([1, 2, 3, 4]),
    }


def homing(draw: Random, told: Told) -> None:
    """Every method, from anywhere, with stops and moves in between."""
    unit = draw.choice(UNITS)
    axes = [
        replace(
            axis(draw, unit, DriveConfig(**homing_config(draw))), gear=1.0, following_error=None
        )
        for _ in range(draw.randint(1, 3))
    ]
    machine = MotionKernel(axes, draw.choice(PERIODS))

    def play(host: Host) -> Generator[int]:
        hand = Hand(draw, told, host, machine.axes)
        host.enable()
        yield 10
        for _ in range(draw.randint(5, 16)):
            hand.give(
                *["home"] * 10,
                *["move", "move", "queued", "queued", "jog", "halt", "quick_stop", "cancel"],
                *["disable", "enable", "enable", "reset", "reset", "hold", "resume"],
            )
            yield draw.choice([*WAITS, 1000, 1000, 2000])
            hand.tell()
        yield from hand.recover()

    run(told, machine, play, 12_000)


# ---- faults --------------------------------------------------------------------------------------


def fault_config(draw: Random) -> dict[str, Any]:
    """Fields of a drive that has its own options, and may be too weak for what is asked."""
    rev = 16777216
    return {
        "fault_option": draw.randint(0, 4),
        "quick_stop_option": draw.randint(0, 8),
        "disable_option": draw.randint(0, 1),
        "shutdown_option": draw.randint(0, 1),
        "abort_option": draw.randint(0, 3),
        "halt_option": draw.randint(1, 4),
        "jump_option": draw.randint(0, 2),
        "following_window": draw.choice([rev, int(rev * draw.uniform(1e-4, 1e-2))]),
        "following_time_ms": draw.choice([0, 5]),
        "software_min": -int(rev * draw.uniform(0.02, 0.2)),
        "software_max": int(rev * draw.uniform(0.02, 0.2)) if draw.random() < 0.3 else 0,
        "load_inertia_ratio": draw.choice([0.0, 1.0, 20.0]),
        "load_torque_nm": draw.choice([0.0, 0.5]),
        "brake_torque_nm": draw.choice([0.0, 2.0]),
        "sync_error_limit": draw.choice([1, 3, 12]),
        "sync_extrapolation": draw.choice([0, 1, 3]),
        "max_torque": draw.choice([3500, 600]),
    }


class Line:
    """Drives outside the kernel: exchanged after each cycle, some words lost on the way."""

    def __init__(
        self, draw: Random, machine: MotionKernel, configs: dict[int, DriveConfig]
    ) -> None:
        self.draw, self.machine = draw, machine
        self.drives = {i: Drive(config) for i, config in configs.items()}
        self.lossy = draw.choice([0.0, 0.0, 0.01, 0.1])
        self.silent: dict[int, int] = {}  # cycles that nothing comes from a drive
        self.wanted = [
            name
            for name in machine.image.outputs.dtype.names or ()
            if name not in ("controlword", "mode", "target_position", "sync_missed")
        ]

    def exchange(self) -> None:
        """What the kernel wants to the drives, what they say back."""
        image, draw = self.machine.image, self.draw
        for i, drive in self.drives.items():
            out = image.outputs[i]
            found = drive.cycle(
                int(out["controlword"]),
                int(out["target_position"]),
                mode=int(out["mode"]),
                sync_missed=draw.random() < self.lossy,
                **{name: int(out[name]) for name in self.wanted if name in _OPTIONS},
            )
            if self.silent.get(i, 0) > 0:
                self.silent[i] -= 1
                image.stale[i] = 1
                continue
            image.stale[i] = 0
            for name in image.inputs.dtype.names or ():
                if hasattr(found, name):
                    image.inputs[i][name] = int(getattr(found, name))


_OPTIONS = (
    "position_offset",
    "velocity_offset",
    "torque_offset",
    "target_velocity",
    "target_torque",
)


def faults(draw: Random, told: Told) -> None:
    """Causes that come and go, drives in and out of the kernel, missed syncs, stale images."""
    unit, T = draw.choice(UNITS), draw.choice(PERIODS)
    configs = [
        DriveConfig(**fault_config(draw)).changed(period_s=T) for _ in range(draw.randint(1, 4))
    ]
    outside = [i for i in range(len(configs)) if draw.random() < 0.5]
    axes = [
        axis(draw, unit, "external" if i in outside else config) for i, config in enumerate(configs)
    ]
    machine = MotionKernel(
        axes, T, reactions=reactions(*draw.choices(["none", "halt", "quick stop"], k=7))
    )
    inside = [i for i in range(len(axes)) if i not in outside]
    line = Line(draw, machine, {i: configs[i] for i in outside})
    present: list[tuple[int, Any]] = []

    def fault(i: int, kind: Any, comes: bool) -> None:
        told.event("fault" if comes else "repaired", i, kind)
        if i in outside:
            line.drives[i].inject(kind, comes)
        else:
            inject(machine, i, kind, comes)

    def passing(cycles: int) -> Generator[int]:
        if not outside:
            yield cycles
            return
        for _ in range(cycles):
            yield 1
            line.exchange()

    def play(host: Host) -> Generator[int]:
        hand = Hand(draw, told, host, machine.axes)
        host.enable()
        yield from passing(30)
        for _ in range(draw.randint(4, 14)):
            what = draw.choice(["order"] * 6 + ["fault", "fault", "repair", "repair", "silence"])
            if what == "order":
                hand.give(
                    *["move", "move", "queued", "queued", "jog", "reset", "reset", "enable"],
                    *["disable", "halt", "quick_stop", "hold", "resume", "override"],
                )
            elif what == "fault":
                new = (draw.choice(inside + outside), draw.choice(_INJECTED))
                fault(*new, True)
                present.append(new)
            elif what == "silence" and outside:
                line.silent[draw.choice(outside)] = draw.choice([1, 3, 20, 200])
            elif what == "repair":
                while present:
                    fault(*present.pop(), False)
                yield from passing(60)
                host.reset(timeout=None)
            yield from passing(draw.choice(WAITS))
            hand.tell()
        while present:
            fault(*present.pop(), False)
        yield from passing(100)
        host.reset(timeout=None)
        yield from passing(30)
        host.enable(timeout=None)
        host.resume()
        host.override(1.0)
        yield from passing(300)
        hand.tell()
        hand.give("move")
        yield from passing(300)
        hand.tell()

    run(told, machine, play, 6500)
    for drive in line.drives.values():
        told.event("verdict", drive.report())
