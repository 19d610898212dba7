"""Touch probes, 60B8h to 60BDh, against a reading of the standard's bit tables."""

from __future__ import annotations

import struct
from fractions import Fraction
from math import floor

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk.cia402 import Drive, DriveConfig, DriveFeedback, Mode
from sjerk.drive import Abort, Device, SdoError

# 60B8h: bits of probe 1; those of probe 2 lie 8 higher, as all of 60B9h does
ENABLE, EACH, INDEX, RISING, FALLING = 0, 1, 2, 4, 5
# 60B9h
ENABLED, RISING_STORED, FALLING_STORED = 0, 1, 2


def bit(word: int, number: int) -> bool:
    return bool(word >> number & 1)


class Page:
    """What the tables say of one probe; it walks increment by increment."""

    def __init__(self, closes: int, opens: int, turn: int) -> None:
        self.closes, self.opens, self.turn = closes, opens, turn
        self.enabled = False
        self.stored: dict[int, bool] = {RISING: False, FALLING: False}
        self.place: dict[int, int | None] = {RISING: None, FALLING: None}

    def events(self, word: int, before: int, after: int) -> list[tuple[int, int]]:
        """(edge, place) in order; a place lies between its increment and the one below."""
        seen = []
        way = 1 if after > before else -1
        for old in range(before, after, way):
            place = max(old, old + way)
            if bit(word, INDEX):
                if place % self.turn == 0:
                    seen += [(RISING, place), (FALLING, place)]
                continue
            was, now = (self.closes <= x < self.opens for x in (old, old + way))
            if was != now:
                seen.append((RISING if now else FALLING, place))
        return seen

    def period(self, word: int, before: int, after: int) -> int:
        """The status bits after a period with this function."""
        self.enabled = bit(word, ENABLE)
        for edge in (RISING, FALLING):
            self.stored[edge] &= self.enabled and bit(word, edge)
        if self.enabled and not bit(word, 3):
            for edge, place in self.events(word, before, after):
                if bit(word, edge) and (bit(word, EACH) or not self.stored[edge]):
                    self.stored[edge], self.place[edge] = True, place
        return (
            self.enabled << ENABLED
            | self.stored[RISING] << RISING_STORED
            | self.stored[FALLING] << FALLING_STORED
        )


@settings(max_examples=60, deadline=None)
@given(data=st.data(), polarity=st.sampled_from([0, 0x80]), gear=st.sampled_from([1, 3, 7]))
def test_positions_are_latched_as_the_tables_say(
    data: st.DataObject, polarity: int, gear: int
) -> None:
    """Any functions, ways, places, units: status and positions of every period, to the unit."""
    turn = 1000
    feed = data.draw(st.sampled_from([turn, 360, 36_000]))
    closes = [data.draw(st.integers(-1500, 1500)) for _ in range(2)]
    opens = [place + data.draw(st.integers(1, 900)) for place in closes]
    pages = [Page(closes[n], opens[n], turn) for n in range(2)]

    def rev(place: int) -> float:
        return (place - 0.5) / turn

    drive = Drive(
        DriveConfig(
            encoder_increments=turn,
            feed=feed,
            gear_motor=gear,
            polarity=polarity,
            probe_1_rev=rev(closes[0]),
            probe_1_end_rev=rev(opens[0]),
            probe_2_rev=rev(closes[1]),
            probe_2_end_rev=rev(opens[1]),
            following_window=0xFFFFFFFF,
        )
    )
    unit = Fraction(feed, gear * turn) * (-1 if polarity else 1)
    feedback = drive.enable(mode=Mode.CSV)
    word, speed = 0, 0
    for k in range(300):
        if k % 20 == 0:
            speed = data.draw(st.integers(-12, 12)) * feed // gear
        if k % 10 == 0:
            word = data.draw(st.one_of(st.integers(0, 0xFFFF), st.sampled_from(WORDS)))
        before = feedback.position_internal
        feedback = drive.cycle(0xF, mode=Mode.CSV, target_velocity=speed, probe_function=word)
        after = feedback.position_internal
        status = [page.period(word >> 8 * n & 0xFF, before, after) for n, page in enumerate(pages)]
        assert feedback.probe_status == status[0] | status[1] << 8
        for page, told in zip(pages, latched(feedback), strict=True):
            for place, value in zip(page.place.values(), told, strict=True):
                sign = -1 if polarity else 1
                expected = 0 if place is None else sign * floor(place * abs(unit) + Fraction(1, 2))
                assert value == expected
    assert bool(feedback.digital_inputs & 1 << 16) is (closes[0] <= after < opens[0])
    assert bool(feedback.digital_inputs & 1 << 17) is (closes[1] <= after < opens[1])


WORDS = [0x0031, 0x3333, 0x3131, 0x3537, 0x1121, 0x2111, 0x0000, 0x3333]


def latched(feedback: DriveFeedback) -> list[tuple[int, int]]:
    return [
        (feedback.probe_1_positive, feedback.probe_1_negative),
        (feedback.probe_2_positive, feedback.probe_2_negative),
    ]


class Scene:
    """An axis that is moved over a probe at half a revolution, by its dictionary."""

    def __init__(self) -> None:
        self.device = Device(Drive(DriveConfig(probe_1_rev=0.5, probe_1_end_rev=0.75)))
        self.rev = 1 << 24
        self.device.write(0x6060, 0, Mode.PROFILE_POSITION)
        for word in (6, 7, 0xF, 0xF):
            self.device.write(0x6040, 0, word)
            self.device.cycle()

    def go(self, revolutions: float) -> None:
        self.device.write(0x607A, 0, round(revolutions * self.rev))
        for word in (0x3F, 0x2F):
            self.device.write(0x6040, 0, word)
            self.device.cycle()
        while not self.device.cycle().statusword & 0x400:
            pass

    def ask(self, function: int) -> int:
        self.device.write(0x60B8, 0, function)
        self.device.cycle()
        return int(self.device.read(0x60B9))


def test_the_sequence_of_the_standards_figure() -> None:
    """Enable, latch, disable an edge, enable it, latch anew, switch off: the values stay."""
    scene = Scene()
    read = scene.device.read
    assert scene.ask(0x0011) == 0x0001
    scene.go(0.6)
    first = read(0x60BA)
    assert (read(0x60B9), first) == (0x0003, scene.rev // 2)
    scene.go(0.4)  # the falling edge is not asked for, and the first rising one stays
    scene.go(0.6)
    assert (read(0x60B9), read(0x60BA), read(0x60BB)) == (0x0003, first, 0)
    assert scene.ask(0x0001) == 0x0001
    assert read(0x60BA) == first
    assert scene.ask(0x0021) == 0x0001
    scene.go(0.4)
    assert (read(0x60B9), read(0x60BB)) == (0x0005, first)
    assert scene.ask(0x0000) == 0x0000
    assert (read(0x60BA), read(0x60BB)) == (first, first)
    scene.go(0.6)
    assert (read(0x60B9), read(0x60BA)) == (0, first)


def test_a_disabled_drive_latches_too() -> None:
    """The encoder sees an axis that coasts through the probe."""
    scene = Scene()
    scene.ask(0x0011)
    scene.device.write(0x607A, 0, 5 * scene.rev)
    for word in (0x3F, 0x2F):
        scene.device.write(0x6040, 0, word)
        scene.device.cycle()
    while scene.device.feedback.position_actual < scene.rev * 2 // 5:
        scene.device.cycle()
    scene.device.write(0x6040, 0, 0)
    for _ in range(3000):
        scene.device.cycle()
    assert scene.device.feedback.position_actual > scene.rev // 2
    assert (scene.device.read(0x60B9), scene.device.read(0x60BA)) == (3, scene.rev // 2)


@pytest.mark.parametrize("function", [0x0008, 0x000C, 0x0800, 0x0C00, 0xFFFF])
def test_sources_that_are_not_there_are_refused(function: int) -> None:
    """10 (60D0h) and 11: 06090030h, and the function stays."""
    device = Device()
    device.write(0x60B8, 0, 0x0011)
    with pytest.raises(SdoError) as caught:
        device.download(0x60B8, 0, struct.pack("<H", function))
    assert caught.value.abort is Abort.RANGE
    assert device.read(0x60B8) == 0x0011
