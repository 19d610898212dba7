"""Random frames against the CANopen node, random words against the C under the sanitizers.

`SJERK_FUZZ_FRAMES` and `SJERK_FUZZ_CYCLES` set how many, `SJERK_FUZZ_SEED` which:
``SJERK_FUZZ_FRAMES=1000000 SJERK_FUZZ_CYCLES=10000000 ./run test tests/drive/test_drive_fuzz.py``.
"""

from __future__ import annotations

import os
import random
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from helpers.root import SOURCES, TESTS
from sjerk._binding import ffi
from sjerk.cia402 import TRANSITIONS, Drive, DriveConfig, DriveState
from sjerk.drive.device import Device
from sjerk.drive.entries import Abort
from sjerk.drive.objects import OBJECTS
from sjerk.ports.canopen import Node

FRAMES = int(os.environ.get("SJERK_FUZZ_FRAMES", "30000"))
CYCLES = int(os.environ.get("SJERK_FUZZ_CYCLES", "300000"))
SEED = int(os.environ.get("SJERK_FUZZ_SEED", "1"))
NODE = 5

LEGAL = {(row.source, row.target) for row in TRANSITIONS} | {
    (DriveState.READY_TO_SWITCH_ON, DriveState.OPERATION_ENABLED),
    (DriveState.READY_TO_SWITCH_ON, DriveState.FAULT_REACTION_ACTIVE),
}


def random_frame(draw: random.Random, device: Device) -> tuple[int, bytes, bool]:
    """Identifier, data, remote: mostly sensible, often not."""
    kind = draw.random()
    if kind < 0.35:  # an SDO request to an object that exists, or nearly
        index = draw.choice(list(OBJECTS)) if draw.random() < 0.9 else draw.randrange(0x10000)
        size = len(OBJECTS[index].entries) if index in OBJECTS else 1
        first = draw.choice(
            (0x40, 0x40, 0x22, 0x23, 0x27, 0x2B, 0x2F, 0x21, 0x20, 0x00, 0x60, 0x70)
        )
        if draw.random() < 0.1:
            first = draw.randrange(256)
        if index in OBJECTS and draw.random() < 0.5:
            row = OBJECTS[index].entries[draw.randrange(size)]
            sub, first = row.sub, {1: 0x2F, 2: 0x2B, 4: 0x23}.get(row.type.size, 0x40)
            data = draw.choice((0, 1, 2, 8, draw.randrange(64), draw.getrandbits(32)))
        else:
            sub, data = draw.randrange(size + 1), draw.getrandbits(32)
        request = bytes((first, index & 0xFF, index >> 8, sub)) + data.to_bytes(4, "little")
        return 0x600 + NODE, request[: 8 if draw.random() < 0.99 else draw.randrange(9)], False
    if kind < 0.60:  # a master that climbs
        word = {
            DriveState.SWITCH_ON_DISABLED: 6,
            DriveState.READY_TO_SWITCH_ON: 7,
            DriveState.FAULT: 0x80,
        }.get(device.feedback.state, 0xF)
        if device.feedback.state is DriveState.FAULT and draw.random() < 0.5:
            word = 0
        if draw.random() < 0.1:
            word = draw.getrandbits(16)
        target = device.feedback.position_demand + draw.randrange(-20_000, 20_000)
        if draw.random() < 0.02:
            target = draw.getrandbits(32)
        target = (target + 2**31) % 2**32
        mode = draw.choice((8, 8, 8, 1, 3, 4, 6, 7, 9, 10, draw.randrange(256)))
        data = bytes((word & 0xFF, word >> 8, mode)) + (target ^ 2**31).to_bytes(4, "little")
        return 0x200 + NODE, data, False
    if kind < 0.90:
        return 0x80, b"", False
    if kind < 0.93:
        return (
            0,
            bytes((draw.choice((1, 1, 1, 2, 0x80, 0x81, 0x82, 7)), draw.choice((0, 5, 6)))),
            False,
        )
    if kind < 0.96:
        return 0x700 + draw.randrange(128), b"\5", draw.random() < 0.1
    return draw.randrange(0x800), draw.randbytes(draw.randrange(9)), draw.random() < 0.3


def test_random_frames_break_nothing() -> None:
    """No exception, no state or transition that is none, an answer of the protocol to each SDO."""
    draw = random.Random(SEED)
    sent: list[tuple[int, bytes]] = []
    device = Device(Drive(), node_id=NODE)
    now = 0.0
    node = Node(device, lambda identifier, data: sent.append((identifier, data)), now=now)
    state = device.feedback.state
    visited = set()
    aborts = {int(abort) for abort in Abort}

    def watch(after: DriveState) -> None:
        nonlocal state
        assert after is state or (state, after) in LEGAL or resets, (state, after)
        visited.add(after)
        state = after

    resets = False
    node.announce(watch)
    for number in range(FRAMES):
        identifier, data, remote = random_frame(draw, device)
        resets = identifier == 0 and data[:1] == b"\x81"
        sent.clear()
        node.take(
            SimpleNamespace(
                arbitration_id=identifier,
                data=bytearray(data),
                is_extended_id=False,
                is_remote_frame=remote,
                is_error_frame=False,
            ),
            now,
        )
        for answer, content in sent:
            assert 0 < answer < 0x800
            assert len(content) <= 8
            if answer == 0x580 + NODE:
                assert len(content) == 8
                if content[0] == 0x80:
                    assert int.from_bytes(content[4:], "little") in aborts
        now += draw.random() * 0.002
        resets = False
        if number % 4 == 0:
            node.tick(now)
        if number % 5000 == 4999:  # a new drive, so that a wild config does not last
            device = Device(Drive(), node_id=NODE)
            node = Node(device, lambda identifier, data: sent.append((identifier, data)), now=now)
            state = device.feedback.state
            node.announce(watch)
    assert visited >= set(DriveState) - {DriveState.NOT_READY_TO_SWITCH_ON}


def test_random_words_under_the_sanitizers(tmp_path: Path) -> None:
    """The drive's C with AddressSanitizer and UndefinedBehaviorSanitizer: clean, promises kept."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    program = tmp_path / "fuzz_drive"
    built = subprocess.run(
        [
            compiler,
            *("-std=c11", "-g", "-O1", "-ffp-contract=off", "-Wall", "-Wextra"),
            "-fsanitize=address,undefined,float-cast-overflow,float-divide-by-zero",
            "-fno-sanitize-recover=all",
            *("-I", str(SOURCES), "-o", str(program)),
            str(TESTS / "drive" / "fuzz_drive.c"),
            *(str(room) for room in sorted(SOURCES.rglob("_*.c"))),
            *("-lm", "-pthread"),
        ],
        capture_output=True,
        text=True,
    )
    if built.returncode and ("cannot find" in built.stderr or "unrecognized" in built.stderr):
        pytest.skip(f"no sanitizers: {built.stderr.splitlines()[-1]}")
    assert built.returncode == 0, built.stderr
    config = tmp_path / "config"
    config.write_bytes(bytes(ffi.buffer(DriveConfig().to_c())))
    done = subprocess.run(
        [program, str(CYCLES), str(SEED), config], capture_output=True, text=True, timeout=3600
    )
    assert done.returncode == 0, done.stderr
    counts = [int(part.partition(":")[2]) for part in done.stdout.split()]
    assert all(count > 0 for count in counts[1:]), done.stdout
