"""What is refused: names, owners, contents. One clear error each, no crash, no hang."""

from __future__ import annotations

import doctest
import errno
import os
import secrets
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sjerk import errors, handshake
from sjerk._binding import ffi, lib
from sjerk.dpram.files import MAGIC
from sjerk.handshake import Layout, Segment, raise_for_status

LAYOUT = Layout(
    command_bytes=16,
    feedback_bytes=16,
    record_bytes=16,
    record_capacity=4,
    event_bytes=16,
    event_capacity=4,
    abi=5,
)
DETERMINISTIC = settings(derandomize=True, deadline=None, max_examples=300)
READY = 96  # offset in the header; see _pages.h


@pytest.fixture
def path(name: str) -> Iterator[Path]:
    """A segment of the dead, to be spoilt."""
    Segment.create(name, LAYOUT).close()
    path = Path(f"/dev/shm/sjerk-{name}")
    yield path
    path.unlink(missing_ok=True)


def formatted() -> bytearray:
    """The bytes of a whole segment."""
    memory = bytearray(LAYOUT.size)
    with ffi.from_buffer("char[]", memory) as base:
        assert lib.sj_shm_format(base, len(base), LAYOUT.config()) == 0
    return memory


# ---- layouts and names --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("command_bytes", 0),
        ("feedback_bytes", 0),
        ("command_bytes", 2**20 + 1),
        ("record_bytes", 0),
        ("record_bytes", -1),
        ("record_capacity", 3),
        ("record_capacity", 2**21),
        ("event_capacity", 2),
        ("event_bytes", 0),
        ("abi", 2**64),
    ],
)
def test_an_impossible_layout_is_refused_with_field_and_value(field: str, value: int) -> None:
    """The message names both."""
    with pytest.raises(ValueError, match=rf"Layout\.{field} = {value}\b"):
        replace(LAYOUT, **{field: value})


@pytest.mark.parametrize("value", [1.0, True, None, "8"])
def test_a_size_that_is_no_int_is_refused(value: Any) -> None:
    """Numbers of bytes are ints."""
    with pytest.raises(TypeError, match=r"Layout\.command_bytes"):
        Layout(command_bytes=value, feedback_bytes=8)


@pytest.mark.parametrize("bad", ["", "a/b", "..", "a.b", "-a", "a b", "ä", "a\0", "a" * 195])
def test_a_bad_name_is_refused(bad: str) -> None:
    """Before the file system sees it."""
    with pytest.raises(errors.SegmentNameError):
        Segment.create(bad, LAYOUT)
    with pytest.raises(errors.SegmentNameError):
        Segment.attach(bad)


def test_the_longest_name_works() -> None:
    """The limit that the message gives is the limit."""
    name = f"test-{secrets.token_hex(6)}".ljust(194, "x")
    with Segment.create(name, LAYOUT), Segment.attach(name, LAYOUT, role="host"):
        pass
    assert not Path(f"/dev/shm/sjerk-{name}").exists()


# ---- owners and permissions ---------------------------------------------------------------------


def test_a_segment_of_another_user_is_refused_unless_asked(
    path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error carries the owner."""
    me = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: me + 1)
    with pytest.raises(errors.SegmentOwnerError) as caught:
        Segment.attach(name, LAYOUT, role="host")
    assert caught.value.uid == me
    Segment.attach(name, LAYOUT, role="host", any_owner=True).close()


def test_a_group_may_be_let_in(name: str) -> None:
    """With ``group`` its members may read and write; others may not."""
    with Segment.create(name, LAYOUT, group=os.getegid()):
        found = Path(f"/dev/shm/sjerk-{name}").stat()
        assert (found.st_mode & 0o777, found.st_gid) == (0o660, os.getegid())


def test_permissions_do_not_depend_on_the_umask(name: str) -> None:
    """A group is let in whatever the umask of the creator."""
    old = os.umask(0o077)
    try:
        with Segment.create(name, LAYOUT, group=os.getegid()):
            assert Path(f"/dev/shm/sjerk-{name}").stat().st_mode & 0o777 == 0o660
    finally:
        os.umask(old)


def test_lack_of_memory_is_an_error_at_creation(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full file system is reported with the size, and nothing is left of the attempt."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(errors.SegmentMemoryError) as caught:
        Segment.create(name, LAYOUT)
    assert caught.value.size == LAYOUT.size


# ---- contents -----------------------------------------------------------------------------------


def spoil(path: Path, at: int, new: bytes) -> None:
    with path.open("r+b") as file:
        file.seek(at)
        file.write(new)


@pytest.mark.parametrize(
    ("at", "new", "error"),
    [
        (READY, bytes(8), errors.SegmentNotReadyError),
        (0, b"GARBAGE!", errors.SegmentGarbageError),
        (8, b"\1", errors.SegmentVersionError),
        (40, b"\6", errors.SegmentLayoutError),
        (48, b"\xff" * 8, errors.SegmentGarbageError),
        (16, b"\xff" * 24, errors.SegmentGarbageError),
        (READY, b"?", errors.SegmentGarbageError),
    ],
)
@pytest.mark.parametrize("role", ["host", "monitor", "kernel"])
def test_spoilt_content_is_refused_with_its_own_error(
    path: Path, name: str, role: Any, at: int, new: bytes, error: type[Exception]
) -> None:
    """Not ready, garbage, another version, another layout: each by its name, for every role."""
    spoil(path, at, new)
    if error is errors.SegmentLayoutError:  # the header must agree with itself to get that far
        other = replace(LAYOUT, abi=6)
        with path.open("r+b") as file:
            content = bytearray(file.read())
            with ffi.from_buffer("char[]", content) as base:
                lib.sj_shm_format(base, len(base), other.config())
            file.seek(0)
            file.write(content)
    with pytest.raises(error):
        Segment.attach(name, LAYOUT, role=role)


@pytest.mark.parametrize("size", [0, 1, 4096, lib.SJ_SHM_SLOTS, LAYOUT.size - 1])
def test_a_truncated_segment_is_refused(path: Path, name: str, size: int) -> None:
    """At whatever length."""
    os.truncate(path, size)
    with pytest.raises(errors.SegmentTruncatedError):
        Segment.attach(name, LAYOUT, role="host")


@pytest.mark.parametrize("kind", ["link", "folder", "fifo"])
def test_what_is_no_file_is_refused(name: str, kind: str) -> None:
    """Links are not followed, pipes are not waited for."""
    path = Path(f"/dev/shm/sjerk-{name}")
    if kind == "link":
        path.symlink_to("/etc/hostname")
    elif kind == "folder":
        path.mkdir()
    else:
        os.mkfifo(path)
    try:
        for role in ("host", "monitor"):
            with pytest.raises(errors.SegmentGarbageError):
                Segment.attach(name, LAYOUT, role=role)
    finally:
        path.rmdir() if kind == "folder" else path.unlink()


def test_another_version_is_named(path: Path, name: str) -> None:
    """The error says which layout was found and which can be read."""
    spoil(path, 8, b"\7\0\0\0\3")
    with pytest.raises(errors.SegmentVersionError, match=r"layout 7\.3, .* reads 2\.x"):
        Segment.attach(name, LAYOUT, role="host")


def test_python_and_c_agree_on_the_magic() -> None:
    """What clean() looks for is what format writes."""
    assert formatted().startswith(MAGIC)


def test_the_examples_in_the_docstrings_run() -> None:
    """Doctests of the room."""
    tried = doctest.testmod(handshake)
    assert tried.attempted > 0
    assert tried.failed == 0


@DETERMINISTIC
@given(st.binary(min_size=0, max_size=200), st.integers(0, 2**15))
def test_garbage_never_crashes_the_check(start: bytes, size: int) -> None:
    """Whatever the bytes, the check gives a status."""
    memory = bytearray(start).ljust(max(size, len(start)), b"\xa5")
    with ffi.from_buffer("char[]", memory) as base:
        assert lib.sj_shm_check(base, len(memory), LAYOUT.config()) < 0


@DETERMINISTIC
@given(st.integers(0, 95), st.integers(1, 255))
def test_no_change_of_the_header_goes_unnoticed(at: int, change: int) -> None:
    """Any single byte of the header but its minor version is guarded."""
    memory = formatted()
    memory[at] ^= change
    minor = 12 <= at < 16
    with ffi.from_buffer("char[]", memory) as base:
        assert (lib.sj_shm_check(base, len(memory), ffi.NULL) == 0) == minor


# ---- what happens to a segment in use -----------------------------------------------------------


def memory(segment: Segment) -> Any:
    """The segment byte by byte."""
    return ffi.cast("char *", segment.base)


def slot(area: int, stride: int, index: int) -> int:
    """Where the first payload byte of a slot lies."""
    return area + stride * index + 64


def test_a_writer_without_the_lock_is_found_by_the_checksum() -> None:
    """A byte changed behind the host's back makes the command corrupt, not obeyed."""
    out = ffi.new("char[16]")
    with Segment.private(LAYOUT) as segment:
        assert lib.sj_command_publish(segment.base, b"0123456789abcdef") == 0
        memory(segment)[slot(lib.SJ_SHM_SLOTS, 128, 0) + 5] = b"X"
        assert lib.sj_command_collect(segment.base, out) == lib.SJ_SHM_CORRUPT_DATA
        with pytest.raises(errors.SegmentCorruptError, match="without the lock"):
            raise_for_status(lib.SJ_SHM_CORRUPT_DATA)
        assert lib.sj_command_publish(segment.base, b"0123456789abcdef") == 0
        assert lib.sj_command_collect(segment.base, out) == 1


def test_a_spoilt_record_stops_the_ring_until_it_is_flushed() -> None:
    """The kernel never steps over a record that it cannot read."""
    out = ffi.new("char[16]")
    ring = lib.SJ_SHM_SLOTS + 2 * lib.SJ_SHM_PAGE
    with Segment.private(LAYOUT) as segment:
        base = segment.base
        assert lib.sj_ring_publish(base, b"x" * 32, 2) == 1
        memory(segment)[slot(ring, 128, 0)] = b"y"
        for _ in range(3):
            assert lib.sj_ring_take(base, out) == lib.SJ_SHM_CORRUPT_DATA
        lib.sj_ring_flush(base)
        assert lib.sj_ring_publish(base, b"z" * 16, 1) == 1
        assert lib.sj_ring_take(base, out) == 1
        assert bytes(ffi.buffer(out)) == b"z" * 16


def test_an_impossible_ring_counter_is_corruption() -> None:
    """A head beyond the ring is not believed."""
    out = ffi.new("char[16]")
    with Segment.private(LAYOUT) as segment:
        ffi.cast("uint64_t *", memory(segment) + lib.SJ_SHM_HOST + 384)[0] = 10**9
        assert lib.sj_ring_take(segment.base, out) == lib.SJ_SHM_CORRUPT_COUNTER
        assert lib.sj_ring_publish(segment.base, b"x" * 16, 1) == lib.SJ_SHM_CORRUPT_COUNTER
        assert lib.sj_ring_waiting(segment.base) == 0


def test_without_ring_and_events_their_calls_do_nothing() -> None:
    """A layout without them is whole."""
    layout = Layout(command_bytes=8, feedback_bytes=8)
    cursor, missed, out = ffi.new("uint64_t *"), ffi.new("uint64_t *"), ffi.new("char[8]")
    with Segment.private(layout) as segment:
        assert lib.sj_ring_publish(segment.base, b"x" * 8, 1) == 0
        assert lib.sj_ring_take(segment.base, out) == 0
        lib.sj_event_publish(segment.base, b"x" * 8)
        assert lib.sj_event_read(segment.base, cursor, out, missed) == 0
