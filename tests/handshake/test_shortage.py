"""What the system lacks, and what else lies in the shared memory: told, and nothing is harmed."""

from __future__ import annotations

import os
import secrets
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from sjerk import Axis, Limits, Monitor, MotionKernel, errors
from sjerk.handshake import Layout, Segment, clean

AXIS = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0)
LAYOUT = Layout(command_bytes=64, feedback_bytes=64)
SHM = Path("/dev/shm")
BEGIN = """
import os, resource, sys
from sjerk import Axis, Limits, Monitor, MotionKernel
from sjerk.errors import SjerkError
from sjerk.handshake import Layout, Segment, clean
AXIS = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0)
"""


def own_shm(options: str, text: str) -> subprocess.CompletedProcess[str]:
    """A program with a /dev/shm of its own, mounted with these options."""
    mount = f"mount -t tmpfs -o {options} tmpfs /dev/shm"
    unshare = shutil.which("unshare")
    if unshare is None or subprocess.run([unshare, "-m", "sh", "-c", mount]).returncode:
        pytest.skip("only who may mount can have a shared memory of its own")
    program = f'{mount} && exec "$0" -c "$1"'
    return subprocess.run(
        [unshare, "-m", "sh", "-c", program, sys.executable, BEGIN + text],
        capture_output=True,
        text=True,
        timeout=300,
    )


START = """
try:
    with MotionKernel([AXIS], name="short"):
        print("runs")
except SjerkError as error:
    print(error)
print(os.listdir("/dev/shm"), flush=True)
"""


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("size=64k", "/dev/shm has no 1331200 bytes left, 65536 of 65536 are free"),
        ("nr_inodes=2", "/dev/shm has no inode left of its 2"),
        ("ro", "/dev/shm is mounted read-only"),
    ],
)
def test_a_shared_memory_that_is_full_is_told_with_its_number(options: str, said: str) -> None:
    """In one line; nothing is left, and no tracker complains."""
    done = own_shm(options, START)
    told, left = done.stdout.splitlines()
    assert told.startswith("segment 'short.trace': " + said.split(" no 1331200")[0])
    assert "size" not in options or " are free" in told
    assert (left, done.stderr) == ("[]", "")


def test_too_few_open_files_are_told_and_harm_no_kernel(tmp_path: Path) -> None:
    """At every place where one may be missing: one error with the limit; the kernel stays found."""
    text = (
        BEGIN
        + """
name = sys.argv[1]
for spare in range(12):
    taken = [os.open("/dev/null", os.O_RDONLY) for _ in range(3)]
    resource.setrlimit(resource.RLIMIT_NOFILE, (taken[0] + spare, 4096))
    for fd in taken:
        os.close(fd)
    done = []
    try:
        done += [Segment.attach(name, role="monitor"), Segment.attach(name, role="host")]
        done += [Segment.attach(name, role="stopper")]
        clean(dry_run=True)
        with MotionKernel([AXIS]):
            pass
        print("works")
    except SjerkError as error:
        print(error)
    for segment in done:
        segment.close()
    resource.setrlimit(resource.RLIMIT_NOFILE, (4096, 4096))
"""
    )
    with MotionKernel([AXIS]) as kernel:
        done = subprocess.run(
            [sys.executable, "-c", text, kernel.name], capture_output=True, text=True, timeout=300
        )
        assert (done.returncode, done.stderr) == (0, "")
        lines = done.stdout.splitlines()
        assert len(lines) == 12
        for line in lines:
            told = "too many files open: the limit of open files of this process is " in line
            assert told or line == "works", line
        assert "too many files" in lines[0]
        with Monitor.attach(kernel.name) as monitor:
            assert monitor.kernel_lives


# ---- what else lies there


def fifo(path: Path) -> None:
    os.mkfifo(path)


def dead_link(path: Path) -> None:
    path.symlink_to("/nowhere")


def link(path: Path) -> None:
    path.symlink_to("/dev/zero")


def unix_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


def letter(path: Path) -> None:
    path.write_text("a letter")


def unreadable(path: Path) -> None:
    path.write_text("a secret")
    path.chmod(0)


KINDS: list[Callable[[Path], None]] = [
    fifo,
    dead_link,
    link,
    unix_socket,
    letter,
    unreadable,
    Path.mkdir,
    Path.touch,
]


@pytest.fixture
def odd() -> Iterator[Path]:
    path = SHM / f"sjerk-odd-{secrets.token_hex(4)}"
    yield path
    if path.is_dir():
        path.rmdir()
    elif path.is_symlink() or path.exists():
        path.unlink()


@pytest.mark.parametrize("make", KINDS, ids=lambda make: make.__name__)
def test_an_odd_entry_ends_no_look_at_the_others(make: Callable[[Path], None], odd: Path) -> None:
    """It is told and left alone; the kernel beside it is found, by name and as the only one."""
    make(odd)
    found = {info.name: info for info in clean()}[odd.name.removeprefix("sjerk-")]
    assert not found.removed
    assert found.problem
    with MotionKernel([AXIS], name=f"beside-{os.getpid()}") as kernel:
        infos = {info.name: info for info in clean(dry_run=True)}
        assert infos[kernel.name].kernel
        assert not infos[odd.name.removeprefix("sjerk-")].kernel
        with Monitor.attach(kernel.name) as monitor:
            assert monitor.kernel_lives
    assert odd.is_symlink() or odd.exists()


@pytest.mark.parametrize("make", KINDS, ids=lambda make: make.__name__)
@pytest.mark.parametrize("suffix", ["", ".trace"])
def test_a_kernel_replaces_no_foreign_file_of_its_name(
    make: Callable[[Path], None], suffix: str, odd: Path
) -> None:
    """It refuses to start, names the file, and leaves everything as it was."""
    name = odd.name.removeprefix("sjerk-")
    taken = odd if not suffix else odd.with_name(odd.name + suffix)
    make(taken)
    before = sorted(os.listdir(SHM))
    try:
        with pytest.raises(errors.SegmentGarbageError, match=str(taken)):
            MotionKernel([AXIS], name=name).__enter__()
        assert sorted(os.listdir(SHM)) == before
    finally:
        if suffix:
            taken.rmdir() if taken.is_dir() else taken.unlink()


@pytest.mark.parametrize("name", [b"sjerk-\xff\xfe", b"sjerk-a\nb", "sjerk-ünï".encode()])
def test_a_name_of_any_bytes_is_listed_in_one_line(name: bytes) -> None:
    """By the command too, whose output takes no such bytes."""
    path = os.fsencode(SHM) + b"/" + name
    Path(os.fsdecode(path)).write_text("a letter")
    try:
        done = subprocess.run(
            [sys.executable, "-m", "sjerk", "clean"], capture_output=True, timeout=300
        )
        assert (done.returncode, done.stderr) == (0, b"")
        lines = [line for line in done.stdout.splitlines() if b"not a segment of sjerk" in line]
        assert lines
    finally:
        os.unlink(path)


def test_the_longest_name_of_a_kernel_is_the_one_that_is_told() -> None:
    """With everything that belongs to a kernel under its name."""
    name = f"long-{os.getpid()}-".ljust(194, "x")
    with MotionKernel([AXIS], name=name) as kernel, Monitor.attach(name):
        assert kernel.alive
    with pytest.raises(errors.SegmentNameError, match="of 195 characters is too long: at most 194"):
        MotionKernel([AXIS], name=name + "x").__enter__()


def test_a_segment_survives_those_who_cannot_map_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """An attaching process that runs out of memory does not remove it."""
    name = f"mapped-{os.getpid()}"
    with Segment.create(name, LAYOUT):
        done = subprocess.run(
            [
                *(sys.executable, "-c"),
                BEGIN
                + """
import mmap
def full(*_, **__):
    raise OSError(12, "Cannot allocate memory")
mmap.mmap = full
for role in ("host", "monitor", "stopper"):
    try:
        Segment.attach(sys.argv[1], role=role)
    except SjerkError as error:
        print(type(error).__name__)
""",
                name,
            ],
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.stdout.split() == ["SegmentMemoryError"] * 3, done.stderr
        Segment.attach(name).close()
