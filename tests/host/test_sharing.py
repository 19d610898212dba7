"""A kernel that a group shares: by Python and by the command line, and who is kept out."""

from __future__ import annotations

import grp
import os
import subprocess
import sys

import pytest

from sjerk import Axis, Host, InputError, Limits, Monitor, MotionKernel

AXIS = Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360.0)
STRANGER = 65534
root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")

# imports first: the other user may not be able to read this user's Python
OTHER = """
import os, sys
from sjerk import Axis, Host, Limits, Monitor, MotionKernel, Recorder
from sjerk.__main__ import main
from sjerk.errors import SjerkError
os.setgroups([])
os.setgid(int(sys.argv[1]))
os.setuid(65534)
name = sys.argv[2]
"""


def other(text: str, name: str, gid: int = STRANGER) -> subprocess.CompletedProcess[str]:
    """A program of another user, whose group is this one."""
    program = [sys.executable, "-c", OTHER + text, str(gid), name]
    return subprocess.run(program, capture_output=True, text=True, timeout=300, cwd="/")


def command(name: str, *words: str) -> subprocess.CompletedProcess[str]:
    text = f"""
sys.exit(main([*{words!r}, *(["--name", name] if name else [])]))
"""
    return other(text, name)


@root
def test_the_members_of_a_group_command_watch_record_and_stop() -> None:
    """Each by any_owner=True; without it each is told how."""
    text = """
for attach in (Host.attach, Monitor.attach, lambda name: Recorder(name, None)):
    try:
        attach(name)
    except SjerkError as error:
        print(error)
with Host.attach(name, any_owner=True) as host:
    host.enable()
    with Recorder(name, None, any_owner=True) as recorder:
        host.move(1.0).wait()
    with Monitor.attach(name, any_owner=True) as monitor:
        monitor.halt()
        print(monitor.feedback().axes[0].position, recorder.cycles > 0)
"""
    with MotionKernel([AXIS], group=STRANGER) as kernel:
        done = other(text, kernel.name)
        said = done.stdout.splitlines()
        assert said[-1] == "1.0 True", done.stderr
        assert len(said) == 4
        for line in said[:3]:
            assert "belongs to user 0, not 65534: any_owner=True (--any-owner) accepts it" in line


@root
def test_the_command_line_of_a_member() -> None:
    """`--any-owner` by name and as the only one; without it the kernel does not count."""
    with MotionKernel([AXIS], group=STRANGER) as kernel:
        name = kernel.name
        for words in (
            ["enable"],
            ["move", "1"],
            ["stop"],
            ["status"],
            ["monitor", "--seconds=0.2"],
        ):
            done = command(
                name, *words, "--any-owner", *(["--json"] if words[0] == "monitor" else [])
            )
            assert done.returncode == 0, (words, done.stderr)
        refused = command(name, "stop")
        assert refused.returncode == 1
        assert "--any-owner" in refused.stderr
        assert command("", "status").returncode == 6


@root
def test_who_is_not_let_in_is_told_by_whom() -> None:
    """Without a group nobody else is; with one only its members."""
    text = """
try:
    Monitor.attach(name, any_owner=True)
except SjerkError as error:
    print(error)
"""
    for group, gid in ((None, STRANGER), ("daemon", STRANGER)):
        with MotionKernel([AXIS], group=group) as kernel:
            done = other(text, kernel.name, gid)
            assert "of user 0 refuses access to user 65534" in done.stdout, done.stderr


def test_a_group_is_checked_where_it_is_named() -> None:
    """By name or number; what is none is told with its value, before anything is made."""
    for group in ("no-such-group", 2**31 - 7, 1.5, True):
        with pytest.raises(InputError, match="group = "):
            MotionKernel([AXIS], group=group)  # type: ignore[arg-type]
    mine = grp.getgrgid(os.getegid())
    for own in (mine.gr_name, mine.gr_gid, str(mine.gr_gid)):
        with MotionKernel([AXIS], group=own) as kernel:
            info = os.stat(f"/dev/shm/sjerk-{kernel.name}")
            assert (info.st_gid, info.st_mode & 0o777) == (mine.gr_gid, 0o660)
            with Host.attach(kernel.name), Monitor.attach(kernel.name):
                pass


@root
def test_a_group_that_the_user_is_not_in_is_refused() -> None:
    """With the group and the user."""
    text = """
try:
    MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 1e4)], name=name, group=0).__enter__()
except SjerkError as error:
    print(error)
print([entry for entry in os.listdir("/dev/shm") if name in entry])
"""
    done = other(text, f"foreign-{os.getpid()}")
    assert done.stdout == "group = 0: user 65534 is not in it\n[]\n", done.stderr
