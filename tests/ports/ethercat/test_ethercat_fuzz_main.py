"""Random and forged answers to a main device that moves drives: no crash, and no wrong target.

``SJERK_FUZZ_FRAMES`` sets how many, ``SJERK_FUZZ_SEED`` which. ``./run stress ethercat`` runs this
file and `test_ethercat_fuzz` under ASan and UBSan. What is drawn: `helpers.ethercat_attack`.
"""

from __future__ import annotations

import os

import numpy as np
import pytest

from helpers.ethercat_attack import Attack, follower
from helpers.ethercat_joined import COUNTS, Joined
from sjerk._binding import ffi, lib
from sjerk.cycle.states import AxisState

FRAMES = int(os.environ.get("SJERK_FUZZ_FRAMES", "12000"))
SEED = int(os.environ.get("SJERK_FUZZ_SEED", "1"))
PARTS = 4
DRIVES = 3
T, VELOCITY = 1e-3, 20.0  # of the axes: s, rev/s


@pytest.mark.parametrize("part", range(PARTS))
def test_no_answer_makes_a_wrong_target(part: int) -> None:
    """Forged answers, wrong counters, floods, another main device: targets stay a motion within the
    limits, the drives find nothing, and a reset brings everything back.
    """
    attack = Attack(SEED * 1000 + part)
    draw = attack.draw
    stops = done = moves = 0
    with Joined(DRIVES, drift_ppm=20) as joined:
        bus, image = joined.c, joined.kernel.image
        joined.enable()
        line, answer = joined.line, joined.line.frame

        def tapped(frame: bytes) -> bytes | None:
            came = answer(frame)
            if came is not None and frame[17] & 0x80:
                attack.past.append(came)
            return came

        line.frame = tapped  # type: ignore[method-assign]
        before = image.outputs["target_position"].astype(np.int64)
        followed = np.zeros(DRIVES, bool)
        most = VELOCITY * T * COUNTS + 1.0
        move = joined.host.move([draw.uniform(-3.0, 3.0) for _ in range(DRIVES)])
        while done < FRAMES // PARTS:
            if draw.random() < 0.003:
                attack.forging = draw.choice((0.0, 0.0002, 0.002, 0.02))
            flood = draw.choice((0, 0, 0, 1, 2, 3)) if draw.random() < 0.99 else 200
            for _ in range(flood):
                sent = bytes(ffi.buffer(bus.flight[0].bytes, bus.flight[0].length))
                frame = attack.frame(sent)
                lib.sj_bus_accept(bus, frame, len(frame))
                done += 1
            joined.main.exchange()
            now = image.outputs["target_position"].astype(np.int64)
            step = np.abs((now - before + 2**31) % 2**32 - 2**31)
            follows = np.array([follower(device) for device in line.devices])
            assert (step <= most)[follows & followed].all(), (done, step / most)
            before, followed = now, follows
            axes = joined.axes
            if any(axis.state == AxisState.ERROR_STOP for axis in axes):
                if joined.main.bus.operational and not any(axis.moving for axis in axes):
                    stops += 1
                    joined.host.reset(timeout=0.0)
                    joined.host.enable(0.0)
            elif move.done and all(axis.follows for axis in axes):
                move = joined.host.move([draw.uniform(-3.0, 3.0) for _ in range(DRIVES)])
                moves += 1
        assert joined.findings() == [{}] * DRIVES
        assert bus.told.stray > done // 2
        joined.until(lambda: joined.main.bus.operational)
        joined.until(lambda: not any(axis.moving for axis in joined.axes), 20_000)
        joined.host.reset(timeout=0.0)
        joined.cycles(10)
        joined.enable()
        move = joined.host.move([1.0, 2.0, 3.0])
        joined.until(lambda: move.done, 20_000)
        joined.cycles(300)
        assert image.outputs["target_position"].tolist() == [COUNTS, 2 * COUNTS, 3 * COUNTS]
        assert [axis.actual_position for axis in joined.axes] == pytest.approx([1, 2, 3], abs=2e-4)
        assert joined.findings() == [{}] * DRIVES
    print(f"{done} forged frames, {moves} moves, {stops} resets")
