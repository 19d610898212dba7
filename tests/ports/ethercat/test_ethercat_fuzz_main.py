"""Random and forged answers to a main device that moves drives: no crash, and no wrong target.

``SJERK_FUZZ_FRAMES`` sets how many, ``SJERK_FUZZ_SEED`` which. ``./run stress ethercat`` runs this
file and `test_ethercat_fuzz` under ASan and UBSan. What is drawn: `helpers.ethercat_attack`.
"""

from __future__ import annotations

import os

import pytest

from helpers.ethercat_attack import Attack, UnderAttack
from helpers.ethercat_joined import Joined
from sjerk._binding import ffi, lib

FRAMES = int(os.environ.get("SJERK_FUZZ_FRAMES", "12000"))
SEED = int(os.environ.get("SJERK_FUZZ_SEED", "1"))
PARTS = 4
DRIVES = 3


@pytest.mark.parametrize("part", range(PARTS))
def test_no_answer_makes_a_wrong_target(part: int) -> None:
    """Forged answers, wrong counters, floods, another main device: targets stay a motion within the
    limits, the drives find nothing, and a reset brings everything back.
    """
    attack = Attack(SEED * 1000 + part)
    draw = attack.draw
    done = 0
    with Joined(DRIVES, drift_ppm=20) as joined:
        bus = joined.c
        joined.enable()
        line, answer = joined.line, joined.line.frame

        def tapped(frame: bytes) -> bytes | None:
            came = answer(frame)
            if came is not None and frame[17] & 0x80:
                attack.past.append(came)
            return came

        line.frame = tapped  # type: ignore[method-assign]
        axes = UnderAttack(joined, draw)
        while done < FRAMES // PARTS:
            if draw.random() < 0.003:
                attack.forging = draw.choice((0.0, 0.0002, 0.002, 0.02))
            flood = draw.choice((0, 0, 0, 1, 2, 3)) if draw.random() < 0.99 else 200
            for _ in range(flood):
                sent = bytes(ffi.buffer(bus.flight[0].bytes, bus.flight[0].length))
                frame = attack.frame(sent)
                lib.sj_bus_accept(bus, frame, len(frame))
                done += 1
            axes.cycle()
        assert joined.findings() == [{}] * DRIVES
        assert bus.told.stray > done // 2
        axes.recovers()
    print(f"{done} forged frames, {axes.moves} moves, {axes.stops} resets")
