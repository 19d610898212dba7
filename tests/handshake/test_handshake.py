"""The dual-port RAM in one process: the exchanges, and the segment as Python opens it."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.exchanges import collect
from sjerk import errors
from sjerk._binding import ffi, lib
from sjerk.handshake import HostWatch, Layout, Segment, clean, raise_for_status

LAYOUT = Layout(
    command_bytes=20,
    feedback_bytes=24,
    record_bytes=12,
    record_capacity=4,
    event_bytes=8,
    event_capacity=8,
    abi=0x1234,
)


@pytest.fixture
def private() -> Iterator[Segment]:
    """Host and kernel in the memory of this process."""
    with Segment.private(LAYOUT) as segment:
        yield segment


def take(segment: Segment) -> bytes | int:
    """The next record, or the status if there is none."""
    out = ffi.new("char[]", LAYOUT.record_bytes)
    status = lib.sj_ring_take(segment.base, out)
    return bytes(ffi.buffer(out)) if status == 1 else status


def read(segment: Segment) -> tuple[bytes, int] | int:
    """The newest frame and its number, or the status if there is none."""
    out, number = ffi.new("char[]", LAYOUT.feedback_bytes), ffi.new("uint64_t *")
    status = lib.sj_feedback_read(segment.base, out, number)
    return (bytes(ffi.buffer(out)), number[0]) if status == 1 else status


def command(value: int) -> bytes:
    return bytes([value % 256]) * LAYOUT.command_bytes


def record(value: int) -> bytes:
    return value.to_bytes(LAYOUT.record_bytes, "little")


# ---- the exchanges ------------------------------------------------------------------------------


def test_a_command_arrives_once_and_whole(private: Segment) -> None:
    """Collect gives each command once, then says that there is none."""
    assert collect(private) == 0
    assert lib.sj_command_publish(private.base, command(7)) == 0
    assert collect(private) == command(7)
    assert collect(private) == 0


def test_the_latest_command_wins(private: Segment) -> None:
    """Of several commands between two cycles the kernel sees the last."""
    for value in range(1, 6):
        assert lib.sj_command_publish(private.base, command(value)) == 0
    assert collect(private) == command(5)
    assert lib.sj_command_collected(private.base) == lib.sj_command_published(private.base) == 5


def test_a_frame_can_be_read_by_anybody_again_and_again(private: Segment) -> None:
    """Reading takes nothing away; the number tells whether it is new."""
    assert read(private) == 0
    for value in range(1, 20):
        frame = bytes([value]) * LAYOUT.feedback_bytes
        lib.sj_feedback_publish(private.base, frame)
        assert read(private) == read(private) == (frame, value)
    assert lib.sj_feedback_latest(private.base) == 19


def test_records_come_in_order_and_once(private: Segment) -> None:
    """The ring gives every record in the order published; a batch that does not fit waits whole."""
    base = private.base
    assert take(private) == 0
    assert lib.sj_ring_publish(base, record(1) + record(2) + record(3), 3) == 1
    assert lib.sj_ring_waiting(base) == 3
    assert lib.sj_ring_publish(base, record(4) + record(5), 2) == 0
    assert take(private) == record(1)
    assert lib.sj_ring_publish(base, record(4) + record(5), 2) == 1
    assert [take(private) for _ in range(5)] == [record(i) for i in (2, 3, 4, 5)] + [0]


def test_a_flush_discards_what_was_published_before_it_and_nothing_after(private: Segment) -> None:
    """Records published after the flush survive it, even if the kernel has not looked meanwhile."""
    base = private.base
    lib.sj_ring_publish(base, record(1) + record(2), 2)
    lib.sj_ring_flush(base)
    lib.sj_ring_publish(base, record(3), 1)
    assert lib.sj_ring_waiting(base) == 1
    assert take(private) == record(3)
    assert take(private) == 0
    assert (lib.sj_ring_taken(base), lib.sj_ring_discarded(base)) == (3, 2)


def test_event_readers_see_exactly_what_they_missed(private: Segment) -> None:
    """A slow reader gets the newest events, and the number of those that were overwritten."""
    cursor, missed = ffi.new("uint64_t *"), ffi.new("uint64_t *")
    out = ffi.new("uint64_t *")

    def drain() -> list[int]:
        seen = []
        while lib.sj_event_read(private.base, cursor, out, missed) == 1:
            seen.append(out[0])
        return seen

    assert drain() == []
    for value in range(1, 4):
        lib.sj_event_publish(private.base, struct.pack("=Q", value))
    assert drain() == [1, 2, 3]
    for value in range(4, 104):
        lib.sj_event_publish(private.base, struct.pack("=Q", value))
    assert drain() == list(range(97, 104))  # capacity - 1: one slot may be under the pen
    assert missed[0] == 93


# ---- the segment --------------------------------------------------------------------------------


def test_host_and_kernel_meet_by_name(name: str) -> None:
    """What the host publishes the kernel collects, and back, through three mappings."""
    with (
        Segment.create(name, LAYOUT, role="kernel") as kernel,
        Segment.attach(name, LAYOUT, role="host") as host,
        Segment.attach(name, LAYOUT) as monitor,
    ):
        lib.sj_command_publish(host.base, command(3))
        assert collect(kernel) == command(3)
        lib.sj_feedback_publish(kernel.base, b"x" * LAYOUT.feedback_bytes)
        assert read(host) == read(monitor) == (b"x" * LAYOUT.feedback_bytes, 1)
        assert kernel.host_lives()
        assert host.kernel_lives()
        assert monitor.host_lives()


def test_a_second_host_is_refused_and_the_first_named(name: str) -> None:
    """One writer: the second attach as host fails and carries the pid of the first."""
    with Segment.create(name, LAYOUT), Segment.attach(name, role="host"):
        with pytest.raises(errors.HostTakenError) as caught:
            Segment.attach(name, role="host")
        assert caught.value.pid == os.getpid()
    assert not Path(f"/dev/shm/sjerk-{name}").exists()


def test_only_this_user_may_open_it(name: str) -> None:
    """Permissions are 0600."""
    with Segment.create(name, LAYOUT):
        assert Path(f"/dev/shm/sjerk-{name}").stat().st_mode & 0o777 == 0o600


def test_close_releases_its_exports_and_is_final(name: str) -> None:
    """Closing raises no BufferError; afterwards the memory is refused."""
    segment = Segment.create(name, LAYOUT)
    assert segment.base
    segment.unlink()
    segment.close()
    segment.close()
    with pytest.raises(errors.SegmentClosedError):
        _ = segment.base


def test_missing_and_taken_names_are_told_apart(name: str) -> None:
    """Nothing there, and somebody there already, are different errors."""
    with pytest.raises(errors.SegmentMissingError):
        Segment.attach(name)
    with Segment.create(name, LAYOUT), pytest.raises(errors.SegmentTakenError):
        Segment.create(name, LAYOUT)


def test_another_payload_layout_is_refused(name: str) -> None:
    """A program that means something else by the same bytes does not get in."""
    other = Layout(command_bytes=20, feedback_bytes=24, abi=0x4321)
    with Segment.create(name, LAYOUT), pytest.raises(errors.SegmentLayoutError):
        Segment.attach(name, other, role="host")


def test_a_host_that_leaves_is_absent_not_dead(name: str) -> None:
    """The kernel tells an orderly end from a death."""
    with Segment.create(name, LAYOUT, role="kernel") as kernel, HostWatch(kernel) as watch:
        state = lambda: lib.sj_shm_host_state(kernel.base, 0)  # noqa: E731
        assert state() == lib.SJ_HOST_ABSENT
        with Segment.attach(name, role="host"):
            watch.look()
            assert state() == lib.SJ_HOST_ALIVE
        watch.look()
        assert state() == lib.SJ_HOST_ABSENT


def test_a_watch_that_cannot_write_or_never_looks_is_refused(private: Segment, name: str) -> None:
    """A monitor's pages are read-only; a period is a time."""
    with pytest.raises(ValueError, match=r"HostWatch\.period_s = 0"):
        HostWatch(private, period_s=0)
    with (
        Segment.create(name, LAYOUT),
        Segment.attach(name) as monitor,
        pytest.raises(ValueError, match="monitor"),
    ):
        HostWatch(monitor)


def test_clean_leaves_living_segments_alone(name: str) -> None:
    """A segment that somebody has open is listed as in use and stays."""
    with Segment.create(name, LAYOUT):
        mine = [info for info in clean() if info.name == name]
        assert [info.in_use for info in mine] == [True]
        assert [info.removed for info in mine] == [False]
        Segment.attach(name).close()


def test_every_status_has_its_error() -> None:
    """No status of the C side is unknown to Python."""
    for status in range(lib.SJ_SHM_KERNEL_RESTARTED, 0):
        with pytest.raises(errors.HandshakeError) as caught:
            raise_for_status(status)
        assert "unknown" not in str(caught.value)
    assert raise_for_status(1) == 1
