"""A SYNC that stops without 1006h: noticed by the interval that it had, however it was."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.canopen_wire import NODE, Wire
from sjerk.cia402 import DriveState
from sjerk.ports.canopen.sync import SyncWatch

REV = 16777216
SPEED = 5.0  # rev/s


class Led(Wire):
    """A wire whose SYNCs come at times that the test gives, CSP at SPEED once enabled."""

    def __init__(self, period_ms: int) -> None:
        super().__init__()
        self.write(0x60C2, 1, period_ms)
        self.write(0x6080, 0, 6000)
        self.write(0x2100, 7, 0)  # learned
        self.put(0, bytes((1, NODE)))
        self.period = period_ms * 1e-3
        self.fine = self.period / 10  # step of the clock
        self.times: list[float] = []
        self.target = 0.0
        self.words = itertools.chain((0x06, 0x07, 0x0F, 0x0F), itertools.repeat(0x0F))
        self.ramp = 0.0

    def until(self, time: float) -> None:
        """The clock goes on to `time` in small steps."""
        while self.now + self.fine < time:
            self.now += self.fine
            self.node.tick(self.now)
        self.now = time
        self.node.tick(time)

    def sync_at(self, time: float) -> None:
        """One SYNC with the targets of its period."""
        self.until(time)
        if self.device.feedback.follows:
            self.ramp = min(1.0, self.ramp + self.period / 0.5)
            self.target += SPEED * self.ramp * self.period * REV
        word = next(self.words)
        data = word.to_bytes(2, "little") + b"\x08"
        self.put(0x200 + NODE, data + round(self.target).to_bytes(4, "little", signed=True))
        self.put(0x80)
        self.times.append(time)

    @property
    def missed(self) -> int:
        return self.device.drive.report().missed_syncs


@given(
    period_ms=st.integers(1, 40),
    jitter=st.floats(0.0, 0.95),
    random=st.randoms(use_true_random=False),
    syncs=st.integers(8, 90),
)
def test_late_and_missing_syncs_are_none_that_stopped_and_one_that_stopped_is_noticed(
    period_ms: int, jitter: float, random: object, syncs: int
) -> None:
    """Each SYNC up to almost a period late and single ones missing: no alarm. Then silence: noticed
    at the larger of 10 ms and four times the longest of the last 64 intervals, and 8700h.
    """
    wire = Led(period_ms)
    begin, skipped = wire.now, -9
    for k in range(1, syncs + 8):
        late = random.uniform(0.0, jitter)  # type: ignore[attr-defined]
        if k > 6 and k - skipped > 3 and random.random() < 0.05:  # type: ignore[attr-defined]
            skipped = k
            continue
        wire.sync_at(begin + (k + late) * wire.period)
    assert wire.device.feedback.state is DriveState.OPERATION_ENABLED
    assert wire.missed == 0
    last = wire.times[-1]
    intervals = [b - a for a, b in itertools.pairwise(wire.times)][-64:]
    limit = max(0.01, 4 * max(intervals))
    wire.until(last + limit - 2 * wire.fine)
    assert wire.missed == 0
    # bridged are three periods; the fourth one of the silence is 8700h
    wire.until(last + max(limit, 4 * wire.period) + wire.period + 2 * wire.fine)
    assert wire.missed >= 4
    assert wire.device.feedback.error_code == 0x8700


@pytest.mark.parametrize("reaction", [0, 2])
@pytest.mark.parametrize(("period_ms", "bound"), [(1, 0.010), (2, 0.010), (5, 0.020), (20, 0.080)])
def test_the_motor_lives_on_at_once_where_the_interval_is_known(
    period_ms: int, bound: float, reaction: int
) -> None:
    """It has gone on through the silence when that is noticed: then it stops along its ramp, or
    coasts, and 606Ch is the speed at which 6064h changes.
    """
    wire = Led(period_ms)
    wire.write(0x605E, 0, reaction)
    wire.write(0x6065, 0, 0xFFFFFFFF)
    begin = wire.now
    for k in range(1, 1000 // period_ms + 10):
        wire.sync_at(begin + k * wire.period)
    feedback = wire.device.feedback
    assert feedback.velocity_actual == pytest.approx(SPEED * REV, rel=0.01)
    stopped, before = wire.now, feedback.position_actual
    wire.until(stopped + bound + 2 * wire.fine)
    # all of the silence has passed for the motor, less the period that is not over
    gone = (wire.device.feedback.position_actual - before) / REV
    least = 4 * wire.period if reaction == 0 else 2 * wire.period
    assert SPEED * least * 0.95 < gone <= SPEED * bound * 1.01
    last, speed = wire.device.feedback.position_actual, wire.device.feedback.velocity_actual
    for k in range(1, 40):
        wire.until(stopped + bound + k * wire.period + 2 * wire.fine)
        feedback = wire.device.feedback
        travelled = (feedback.position_actual - last) / wire.period
        mean = (speed + feedback.velocity_actual) / 2
        assert mean == pytest.approx(travelled, abs=0.15 * REV)
        last, speed = feedback.position_actual, feedback.velocity_actual
    assert feedback.error_code == 0x8700


@pytest.mark.parametrize("silence_ms", [500, 0])
def test_before_the_interval_is_known_a_silence_is_half_a_second(silence_ms: int) -> None:
    """Three intervals do not tell it; the default is fixed, so that a heartbeat counts first."""
    wire = Wire()
    assert wire.device.read(0x2100, 7) == 500
    wire.write(0x2100, 7, silence_ms)
    wire.enable()
    wire.pass_time(0.49)
    assert wire.device.feedback.follows
    wire.pass_time(0.02)
    assert wire.device.feedback.error_code == 0x8700


@pytest.mark.parametrize("fixed_ms", [2, 100, 1000])
def test_a_limit_that_was_set_is_the_limit(fixed_ms: int) -> None:
    """2100h:7 = 100 ms stays that, whatever the interval is."""
    wire = Led(1)
    wire.write(0x2100, 7, fixed_ms)
    begin = wire.now
    for k in range(1, 100):
        wire.sync_at(begin + k * 1e-3)
    wire.until(wire.times[-1] + fixed_ms * 1e-3 - 2 * wire.fine)
    assert wire.missed == 0
    wire.until(wire.times[-1] + fixed_ms * 1e-3 + 2 * wire.fine)
    assert wire.missed > 0


def test_a_silence_is_not_learned_and_another_period_is() -> None:
    """After ten seconds without SYNC the limit is what it was; a SYNC of another period is known
    from its second interval.
    """
    watch, now = SyncWatch(), 0.0
    for _ in range(100):
        now += 0.002
        watch.take(now)
    assert watch.limit == 0.01
    now += 10.0
    watch.take(now)
    assert watch.limit == 0.01
    for _ in range(3):
        now += 0.002
        watch.take(now)
    assert watch.limit == 0.01
    for _ in range(2):
        now += 0.1
        watch.take(now)
    assert watch.limit == pytest.approx(0.4)
    for _ in range(64):
        now += 0.002
        watch.take(now)
    assert watch.limit == 0.01


def test_a_slow_sync_becomes_known() -> None:
    """Each interval is longer than the limit before it is known: from the sixth on it is not."""
    watch = SyncWatch()
    for k in range(6):
        watch.take(2.0 * k)
    assert watch.limit == 8.0
