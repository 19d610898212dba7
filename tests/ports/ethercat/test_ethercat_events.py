"""What goes wrong on a bus: what each axis does, what is told, and the way back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from helpers.ethercat_bench import Bench
from helpers.ethercat_joined import Joined
from sjerk.cia402 import DriveFault
from sjerk.cycle.states import AxisState
from sjerk.ports.ethercat import BusSettings
from sjerk.recording import Recorder, replay

ERROR = AxisState.ERROR_STOP


@pytest.fixture
def moving() -> Any:
    """Four drives in the midst of a long move."""
    with Joined(4, drift_ppm=20) as joined:
        joined.enable()
        joined.move = joined.host.move([200.0] * 4)
        joined.cycles(200)
        yield joined


def states(joined: Joined) -> list[AxisState]:
    return [axis.state for axis in joined.axes]


def come_back(joined: Joined) -> None:
    """At rest, reset, and move all axes again without a finding since."""
    joined.until(lambda: joined.main.bus.operational, 4000)
    joined.until(lambda: all(abs(axis.actual_velocity) < 1e-3 for axis in joined.axes), 20_000)
    joined.cycles(10)
    joined.host.reset()
    joined.until(lambda: ERROR not in states(joined))
    before = joined.findings()
    joined.enable()
    move = joined.host.move([axis.position + 1.0 for axis in joined.axes])
    joined.until(lambda: move.done)
    assert joined.findings() == before
    assert all(device.state == 8 for device in joined.line.devices)


def test_answers_lost_now_and_then_disturb_nothing(moving: Joined) -> None:
    """Every 10th answer lost: counted per drive, the move goes on, the drives find nothing."""
    moving.line.lose(every=10)
    moving.cycles(500)
    assert states(moving) == [AxisState.DISCRETE_MOTION] * 4
    assert moving.c.told.lost == pytest.approx(50, abs=2)
    assert all(moving.c.drive[k].told.lost >= 48 for k in range(4))
    assert moving.findings() == [{}] * 4
    assert moving.said == []


def test_a_wrong_counter_keeps_the_inputs_of_before(moving: Joined) -> None:
    """Every 20th working counter wrong: told apart from lost frames, no axis stops."""
    moving.line.wkc(every=20)
    moving.cycles(400)
    assert states(moving) == [AxisState.DISCRETE_MOTION] * 4
    assert moving.c.told.lost == 0
    assert all(moving.c.drive[k].told.wrong == pytest.approx(20, abs=1) for k in range(4))
    assert moving.findings() == [{}] * 4


def test_a_cable_pulled_behind_the_second_drive(moving: Joined) -> None:
    """Two halt along their limits, two are lost and in ErrorStop; plugged in they come back."""
    moving.line.cut(2)
    moving.cycles(moving.c.lost + 8)
    assert states(moving)[2:] == [ERROR, ERROR]
    moving.until(lambda: not any(axis.moving for axis in moving.axes[:2]))
    moving.cycles(2)
    assert states(moving)[:2] == [AxisState.STANDSTILL] * 2
    assert moving.findings()[:2] == [{}, {}]
    assert moving.c.told.present == 2
    assert any("device 2: gone; 2 of 4" in text for text in moving.said)
    moving.cycles(500)
    moving.line.heal()
    assert moving.until(lambda: moving.main.bus.operational) <= 150
    assert states(moving)[2:] == [ERROR, ERROR]  # until a reset
    come_back(moving)


def test_a_cable_pulled_at_the_main_device(moving: Joined) -> None:
    """All axes are in ErrorStop; all come back after a reset."""
    moving.line.cut(0)
    moving.cycles(300)
    assert states(moving) == [ERROR] * 4
    moving.line.heal()
    come_back(moving)


def test_a_drive_without_power_is_set_up_anew(moving: Joined) -> None:
    """Its axis is in ErrorStop, the others halt; it gets address, clock and mapping again."""
    moving.line.power_cycle(3)
    moving.cycles(moving.c.lost + 8)
    assert states(moving)[3] == ERROR
    assert moving.until(lambda: moving.main.bus.operational) <= 400
    assert any("was without power" in text for text in moving.said)
    moving.cycles(300)
    words = moving.line.devices[3].controller
    assert not words.tx.statusword & 4  # no current until a reset
    assert not words.rx.controlword & 8
    come_back(moving)
    deviations = [device["deviation_ns"] for device in moving.line.status()["devices"]]
    assert abs(deviations[3]) < 1000


@pytest.mark.parametrize("status", [0x14, 0x04])
def test_a_drive_that_drops_to_safeop(moving: Joined, status: int) -> None:
    """The working counter is still right: its state tells. It is brought back by itself."""
    moving.line.state(2, status, 0x1A)
    moving.cycles(12)
    assert states(moving)[2] == ERROR
    assert [state for k, state in enumerate(states(moving)) if k != 2].count(ERROR) == 0
    assert moving.until(lambda: moving.main.bus.operational) <= 200
    assert any(f"{status:02X}h" in text and "001Ah" in text for text in moving.said)
    come_back(moving)


def test_a_fault_of_one_drive(moving: Joined) -> None:
    """Its axis is in ErrorStop with its code, the others halt; the bus stays Operational."""
    moving.line.inject(1, DriveFault.OVER_CURRENT)
    moving.cycles(20)
    assert states(moving)[1] == ERROR
    assert moving.axes[1].error_code == 0x2310
    assert moving.main.bus.operational
    moving.line.inject(1, DriveFault.OVER_CURRENT, False)
    moving.until(lambda: not moving.host.feedback().moving)
    come_back(moving)


def test_a_late_kernel_keeps_its_phase(moving: Joined) -> None:
    """Nearly three cycles late: bridged by the drives, counted, and the phase is as before."""
    phase = moving.c.told.phase_ns
    moving.line.advance(2_800_000)
    moving.cycles(40)
    assert moving.kernel.core.feedback.late == 1
    assert states(moving) == [AxisState.DISCRETE_MOTION] * 4
    assert abs(moving.c.told.phase_ns - phase) < 2000


def test_a_kernel_that_is_too_late_stops_the_drives(moving: Joined) -> None:
    """Eight cycles late: the drives fall out with 001Ah, all is told, all come back."""
    moving.line.advance(9_000_000)
    moving.cycles(40)
    assert states(moving) == [ERROR] * 4
    assert any("001Ah" in text for text in moving.said)
    come_back(moving)


def test_another_main_device_is_never_fought(moving: Joined) -> None:
    """It takes the drives to Init: all axes in ErrorStop, told in 100 ms, and they stay down."""
    bench = Bench(moving.line)
    for k in range(4):
        bench.request(k, 0x01)
    before = moving.line.now
    moving.until(lambda: bool(moving.c.told.foreign))
    assert moving.line.now - before < 100e6
    moving.cycles(500)
    assert states(moving) == [ERROR] * 4
    assert all(device.state == 1 for device in moving.line.devices)
    assert any("another main device" in text for text in moving.said)


def test_devices_stay_down_where_that_is_wanted() -> None:
    """Without `recover` a drive that fell out is told and left alone."""
    with Joined(2, settings=BusSettings(recover=False)) as joined:
        joined.enable()
        joined.line.state(1, 0x14, 0x1B)
        joined.cycles(500)
        assert not joined.main.bus.operational
        assert joined.line.devices[1].state == 4
        assert states(joined)[1] == ERROR


def test_a_run_with_faults_is_recorded_and_replayed(tmp_path: Path) -> None:
    """Lost frames, a pulled cable and the way back again from the recording alone, to the bit."""
    file = tmp_path / "run.parquet"
    joined = Joined(3, drift_ppm=20)
    with Recorder(joined.kernel, file), joined:
        joined.enable()
        joined.host.move([3.0, 4.0, 5.0])
        joined.cycles(100)
        joined.line.cut(1)
        joined.cycles(200)
        joined.line.heal()
        joined.line.lose(every=9)
        joined.until(lambda: joined.main.bus.operational)
        joined.line.lose(every=0)
        come_back(joined)
    assert replay(file).identical
