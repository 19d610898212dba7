"""The dual-port RAM between processes: start methods, kill -9, restarts, locks, what is left."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest

from helpers.exchanges import collect
from sjerk import errors
from sjerk._binding import ffi, lib
from sjerk.handshake import HostWatch, Layout, Segment, clean, raise_for_status

LAYOUT = Layout(
    command_bytes=512,
    feedback_bytes=512,
    record_bytes=64,
    record_capacity=16,
    event_bytes=64,
    event_capacity=16,
    abi=77,
)
PATIENCE_S = 60  # against a hang, not a measure


def command(value: int) -> bytes:
    return bytes([value]) * LAYOUT.command_bytes


def stay(name: str, role: Any, pipe: Connection) -> None:
    """A child: attach, publish one command as host, tell, and stay until the pipe closes."""
    with Segment.attach(name, LAYOUT, role=role) as segment:
        if role == "host":
            raise_for_status(lib.sj_command_publish(segment.base, command(9)))
        pipe.send(os.getpid())
        with contextlib.suppress(EOFError):
            pipe.recv()


class Child:
    """A process that stays attached until it is killed or told to end."""

    def __init__(self, name: str, role: str, method: str = "spawn") -> None:
        context: Any = multiprocessing.get_context(method)
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=stay, args=(name, role, theirs))
        self.process.start()
        theirs.close()
        assert self.pipe.poll(PATIENCE_S)
        self.pid = self.pipe.recv()

    def kill(self) -> None:
        os.kill(self.pid, signal.SIGKILL)
        self.process.join()

    def end(self) -> int | None:
        self.pipe.close()
        self.process.join()
        code: int | None = self.process.exitcode
        return code


def script(text: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a Python program of its own."""
    start = (
        "import os, signal, sys\nfrom sjerk import errors\nfrom sjerk._binding import ffi, lib\n"
    )
    start += "from sjerk.handshake import Layout, Segment, clean\n"
    start += f"LAYOUT = {LAYOUT!r}\n"
    return subprocess.run(
        [sys.executable, "-c", start + textwrap.dedent(text), *arguments],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )


# ---- start methods ------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_a_host_in_a_child_speaks_to_the_kernel(name: str, method: str) -> None:
    """A child started either way attaches by name, publishes, and leaves in order."""
    with Segment.create(name, LAYOUT, role="kernel") as kernel:
        child = Child(name, "host", method)
        assert collect(kernel) == command(9)
        assert kernel.host_lives()
        assert child.end() == 0
        assert not kernel.host_lives()
        assert lib.sj_shm_host_state(kernel.base, 0) == lib.SJ_HOST_ABSENT


def test_a_forked_child_is_refused_and_holds_no_lock(name: str) -> None:
    """After fork the child cannot write, and the host's lock still ends with the host."""
    done = script(
        """
        name = sys.argv[1]
        with Segment.create(name, LAYOUT, role="kernel") as kernel:
            told, tell = os.pipe()
            wait, release = os.pipe()
            middle = os.fork()
            if middle == 0:
                host = Segment.attach(name, LAYOUT, role="host")
                if os.fork() == 0:
                    os.close(release)
                    try:
                        host.base
                    except errors.ForkedError as error:
                        os.write(tell, b"refused")
                    host.close()
                    os.read(wait, 1)
                    os._exit(0)
                os.read(wait, 1)
            assert os.read(told, 7) == b"refused"
            assert kernel.host_lives()
            os.kill(middle, signal.SIGKILL)
            os.waitpid(middle, 0)
            assert not kernel.host_lives(), "the grandchild holds the lock"
            Segment.attach(name, LAYOUT, role="host").close()
            os.close(release)
        print("good")
        """,
        name,
    )
    assert (done.stdout, done.stderr) == ("good\n", "")


def test_a_segment_cannot_be_pickled() -> None:
    """It says what to pass instead."""
    with Segment.private(LAYOUT) as segment, pytest.raises(TypeError, match="name and layout"):
        multiprocessing.reduction.ForkingPickler.dumps(segment)


# ---- the tracker trap ---------------------------------------------------------------------------


def test_a_process_that_merely_attaches_does_not_take_the_segment_with_it(name: str) -> None:
    """Exit of an attached process leaves the segment, and its tracker says nothing."""
    with Segment.create(name, LAYOUT):
        for role in ("host", "monitor", "kernel"):
            done = script("Segment.attach(sys.argv[1], role=sys.argv[2])", name, role)
            assert (done.returncode, done.stderr) == (0, "")
        Segment.attach(name).close()


def test_a_killed_creator_leaves_its_segment_to_the_living(name: str) -> None:
    """After kill -9 of the creator the kernel's memory is still there by name."""
    done = script("Segment.create(sys.argv[1], LAYOUT); os.kill(os.getpid(), signal.SIGKILL)", name)
    assert (done.returncode, done.stderr) == (-signal.SIGKILL, "")
    Segment.attach(name).close()
    assert [info.removed for info in clean() if info.name == name] == [True]


def test_other_shared_memory_is_still_tracked(name: str) -> None:
    """The tracker is kept from our segments only."""
    done = script(
        """
        from multiprocessing import resource_tracker, shared_memory
        with Segment.create(sys.argv[1], LAYOUT):
            other = shared_memory.SharedMemory(create=True, size=64)
            print(other.name, flush=True)
        os._exit(0)
        """,
        name,
    )
    other = Path("/dev/shm") / done.stdout.strip()
    for _ in range(PATIENCE_S * 100):
        if not other.exists():
            break
        os.sched_yield()
        signal.sigtimedwait([], 0.01)
    assert not other.exists()


# ---- the host dies ------------------------------------------------------------------------------


def test_a_killed_host_is_dead_and_its_place_free(name: str) -> None:
    """The kernel is told of the death; a new host begins an epoch and disturbs nothing."""
    with Segment.create(name, LAYOUT, role="kernel") as kernel:
        watch = HostWatch(kernel)
        child = Child(name, "host")
        with pytest.raises(errors.HostTakenError) as caught:
            Segment.attach(name, LAYOUT, role="host")
        assert caught.value.pid == child.pid
        assert watch.look()
        child.kill()
        assert not watch.look()
        assert lib.sj_shm_host_state(kernel.base, 0) == lib.SJ_HOST_DEAD
        with Segment.attach(name, LAYOUT, role="host") as host:
            assert lib.sj_shm_host_epoch(host.base) == 2
            assert lib.sj_shm_host_state(kernel.base, 0) == lib.SJ_HOST_ALIVE
            assert collect(kernel) == command(9)  # the dead host's last word still counts
            assert collect(kernel) == 0


def test_the_watch_notices_a_death_by_itself(name: str) -> None:
    """Without any call of the kernel the cycle sees the death."""
    with Segment.create(name, LAYOUT, role="kernel") as kernel, HostWatch(kernel):
        child = Child(name, "host")
        child.kill()
        while lib.sj_shm_host_state(kernel.base, 0) != lib.SJ_HOST_DEAD:
            os.sched_yield()


def test_a_silent_host_is_alive_unless_it_asked_to_be_watched(name: str) -> None:
    """Silence is told from death, and means something only on request."""
    ms = 1_000_000
    with (
        Segment.create(name, LAYOUT, role="kernel") as kernel,
        Segment.attach(name, LAYOUT, role="host") as host,
    ):

        def state(now_ns: int) -> int:
            return int(lib.sj_shm_host_state(kernel.base, now_ns))

        now = lib.sj_shm_host_beat(kernel.base)
        assert state(now + 10**15) == lib.SJ_HOST_ALIVE
        lib.sj_shm_watch_host(host.base, 500 * ms, now)
        assert state(now + 500 * ms) == lib.SJ_HOST_ALIVE
        assert state(now + 501 * ms) == lib.SJ_HOST_SILENT
        lib.sj_shm_beat_host(host.base, now + 400 * ms)
        assert state(now + 501 * ms) == lib.SJ_HOST_ALIVE
        assert state(now + 399 * ms) == lib.SJ_HOST_ALIVE
        lib.sj_shm_watch_host(host.base, 0, now)
        assert state(now + 10**15) == lib.SJ_HOST_ALIVE


# ---- the kernel dies ----------------------------------------------------------------------------


def test_a_killed_kernel_is_replaced_and_old_commands_are_not_obeyed(name: str) -> None:
    """A restart refuses what was meant for the dead kernel, and the host is told."""
    record = bytes(LAYOUT.record_bytes)
    with (
        Segment.create(name, LAYOUT),
        Segment.attach(name, LAYOUT, role="host") as host,
    ):
        child = Child(name, "kernel")
        assert lib.sj_shm_address(host.base) == 1
        assert lib.sj_command_publish(host.base, command(1)) == 0
        assert lib.sj_ring_publish(host.base, record, 1) == 1
        assert host.kernel_lives()
        with pytest.raises(errors.KernelTakenError):
            Segment.attach(name, LAYOUT, role="kernel")
        child.kill()
        assert not host.kernel_lives()
        with Segment.attach(name, LAYOUT, role="kernel") as kernel:
            out = ffi.new("char[]", LAYOUT.record_bytes)
            assert collect(kernel) == 0
            assert lib.sj_ring_take(kernel.base, out) == 0
            for status in (
                lib.sj_command_publish(host.base, command(2)),
                lib.sj_ring_publish(host.base, record, 1),
            ):
                with pytest.raises(errors.KernelRestartedError) as caught:
                    host.check(status)
                assert caught.value.epoch == 2
            assert lib.sj_shm_address(host.base) == 2
            assert lib.sj_command_publish(host.base, command(3)) == 0
            assert collect(kernel) == command(3)
        assert lib.sj_shm_kernel_left(host.base)


# ---- monitors -----------------------------------------------------------------------------------


def test_a_monitor_cannot_write(name: str) -> None:
    """Its pages are read-only: the processor refuses."""
    with Segment.create(name, LAYOUT, role="kernel") as kernel:
        before = lib.sj_feedback_latest(kernel.base)
        done = script("lib.sj_feedback_publish(Segment.attach(sys.argv[1]).base, b'x' * 512)", name)
        assert done.returncode == -signal.SIGSEGV
        assert lib.sj_feedback_latest(kernel.base) == before


# ---- what is left -------------------------------------------------------------------------------


def test_a_stale_segment_is_told_from_a_living_one_and_can_be_replaced(name: str) -> None:
    """A name whose users all died is refused with the way out, or replaced on request."""
    script("Segment.create(sys.argv[1], LAYOUT); os.kill(os.getpid(), signal.SIGKILL)", name)
    with pytest.raises(errors.SegmentStaleError):
        Segment.create(name, LAYOUT)
    with Segment.create(name, LAYOUT, replace_stale=True), pytest.raises(errors.SegmentTakenError):
        Segment.create(name, LAYOUT, replace_stale=True)


@pytest.mark.parametrize("role", ["host", "kernel", "monitor"])
def test_clean_spares_whatever_anybody_has_open(name: str, role: str) -> None:
    """As long as one process of any role lives the segment stays; then it goes."""

    def mine() -> list[tuple[bool, bool]]:
        return [(info.in_use, info.removed) for info in clean() if info.name == name]

    owner = Segment.create(name, LAYOUT)
    child = Child(name, role)
    owner.close()
    assert mine() == [(True, False)]
    child.kill()
    assert [info.removed for info in clean(dry_run=True) if info.name == name] == [False]
    assert mine() == [(False, True)]
    assert mine() == []


def test_clean_removes_what_a_creator_killed_in_the_middle_left(name: str) -> None:
    """A segment that never got its name is removed whatever is in it."""
    path = Path(f"/dev/shm/sjerk-{name}.unborn-1-2")
    path.write_bytes(bytes(4096))
    found = [info for info in clean() if info.name.startswith(name)]
    assert [info.removed for info in found] == [True]
    assert not path.exists()


def test_clean_leaves_files_that_are_no_segments(name: str) -> None:
    """A stranger's file in our namespace is named, not deleted."""
    path = Path(f"/dev/shm/sjerk-{name}")
    path.write_bytes(b"a letter")
    found = [info for info in clean() if info.name == name]
    assert [(info.removed, info.problem) for info in found] == [(False, "not a segment of sjerk")]
    path.unlink()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_a_stranger_neither_opens_nor_removes_it(name: str) -> None:
    """Another user is refused with the owner's number, and clean() lists without removing."""
    with Segment.create(name, LAYOUT):
        done = script(
            """
            os.setgid(65534)
            os.setuid(65534)
            for role in ("host", "monitor"):
                try:
                    Segment.attach(sys.argv[1], role=role)
                except errors.SegmentOwnerError as error:
                    print(error.uid)
            print([info.removed for info in clean() if info.name == sys.argv[1]])
            """,
            name,
        )
        assert (done.stdout.split(), done.stderr) == (["0", "0", "[False]"], "")
