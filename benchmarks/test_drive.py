"""The drives: computing time per SYNC period and per inner step of the 8 kHz loop."""

from __future__ import annotations

from typing import Any

import pytest

from conftest import Report
from sjerk._binding import ffi, lib
from sjerk.cia402 import MOTORS, Drive, DriveConfig
from sjerk.drive.device import Device


class Group:
    """Drives that follow a slow ramp, all cycled by one call."""

    def __init__(self, count: int, period_s: float) -> None:
        config = DriveConfig(period_s=period_s).to_c()
        self.count = count
        self.drives = ffi.new("sj_drive[]", count)
        self.rx = ffi.new("sj_drive_rx[]", count)
        self.tx = ffi.new("sj_drive_tx[]", count)
        self.each = [
            ffi.new(f"{kind} *[]", [array + i for i in range(count)])
            for kind, array in (
                ("sj_drive", self.drives),
                ("sj_drive_rx", self.rx),
                ("sj_drive_tx", self.tx),
            )
        ]
        for i in range(count):
            assert lib.sj_drive_init(self.drives + i, config) == 0
            self.rx[i].mode = 8
        for word in (0, 6, 7, 15, 15):
            for i in range(count):
                self.rx[i].controlword = word
            self.cycle()
        for i in range(count):
            self.rx[i].target_position = 1000
        self.cycle()
        assert all(t.statusword & 0x1000 for t in self.tx)
        self.steps = self.drives[0].constants.steps

    def cycle(self) -> None:
        lib.sj_drive_cycles(*self.each, self.count)


@pytest.mark.parametrize("period_us", [1000, 250])
@pytest.mark.parametrize("count", [1, 7])
def test_drives_per_period(benchmark: Any, report: Report, count: int, period_us: int) -> None:
    """One period of all drives, words to words."""
    group = Group(count, period_us * 1e-6)
    benchmark(group.cycle)
    if benchmark.stats:
        best = benchmark.stats.stats.min
        report.line(
            "drives: computing time per period (goal: 7 drives at 1 ms in 5 us)",
            f"{count} at {period_us:4} us: {best * 1e6:6.2f} us, "
            f"{best * 1e9 / count / group.steps:6.1f} ns per inner step ({group.steps} a period)",
        )


def test_one_period_from_python(benchmark: Any) -> None:
    """Drive.cycle: the same through Python's words."""
    drive = Drive()
    drive.enable()
    benchmark.extra_info["against"] = {"test_drives_per_period[1-1000]": ""}
    benchmark(drive.cycle, 0xF, 0)


def test_one_period_through_the_dictionary(benchmark: Any) -> None:
    """A receive PDO, a period, a transmit PDO: what a port does at each SYNC."""
    device = Device()
    data = bytes((0x0F, 0x00, 8, 0, 0, 0, 0))
    for word in (0, 6, 7, 15, 15):
        device.receive(0, bytes((word,)) + data[1:])
        device.cycle()

    def period() -> bytes:
        device.receive(0, data)
        device.cycle()
        return device.transmit(0)

    benchmark.extra_info["against"] = {"test_one_period_from_python": ""}
    benchmark(period)


@pytest.mark.parametrize("motor", MOTORS)
def test_steady_following_error_and_ripple(report: Report, motor: str) -> None:
    """(1 - ff) v / Kp at 1000 rpm, and the ripple that interpolation leaves at 1 ms."""
    for feedforward in (0.0, 0.5, 1.0):
        drive = Drive(
            DriveConfig.for_motor(
                motor, velocity_feedforward=feedforward, following_window=0xFFFFFFFF
            )
        )
        target, speed = drive.enable().position_demand, 1000 / 60 * 2**24
        errors = []
        for k in range(2000):
            target += round(speed * 1e-3 * min(1.0, k / 100))
            feedback = drive.cycle(0xF, target)
            if k >= 1800:
                errors.append(feedback.following_error)
        law = speed / drive.config.position_gain_per_s
        off = (sum(errors) / len(errors) - (1 - feedforward) * law) / law
        report.line(
            "steady following error at 1000 rpm against (1 - ff) v / Kp",
            f"{motor} ff {feedforward:3.1f}: off {off:+.1e} of v / Kp, "
            f"ripple {max(errors) - min(errors)} increments",
        )
