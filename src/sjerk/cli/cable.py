"""A pair of virtual cables in a network namespace of its own, and simulated drives at its end.

Never here: frames, motion.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from sjerk.errors import SjerkError

#: Where the main device is, and where the drives are.
MAIN, DRIVES = "ecm", "ecs"
_CABLE = (
    f"ip link add {MAIN} type veth peer name {DRIVES} && ip link set lo up && "
    f"ip link set {MAIN} up && ip link set {DRIVES} up"
)
_NAMESPACE = ("unshare", "-Urn", "sh", "-c")


def inside(command: Sequence[str]) -> list[str]:
    """The command that runs another one where the cables are.

    Raises SjerkError, with what is missing, where no such namespace can be had.
    """
    try:
        tried = subprocess.run([*_NAMESPACE, _CABLE], capture_output=True, text=True)
    except FileNotFoundError as fault:
        raise SjerkError(f"a network namespace needs the program {fault.filename}") from fault
    if tried.returncode:
        said = " ".join(tried.stderr.split())
        raise SjerkError(f"no network namespace with a pair of cables: {said}")
    return [*_NAMESPACE, f'{_CABLE} && exec "$@"', "sh", *command]


def first(command: Sequence[str]) -> list[str]:
    """The command that runs another one before what else runs, where the system allows that."""
    real_time = ["chrt", "-f", "20"]
    if shutil.which(real_time[0]) is None:
        return [*command]
    tried = subprocess.run([*real_time, "true"], capture_output=True)
    return [*command] if tried.returncode else [*real_time, *command]


@contextmanager
def drives(count: int) -> Iterator[None]:
    """Simulated drives at the end of the cable, in a process of their own."""
    command = [sys.executable, "-m", "sjerk", "drive", "--ethercat", DRIVES]
    process = subprocess.Popen(
        [*command, "--drives", str(count)],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=os.setpgrp,  # Ctrl-C is the kernel's to turn into a stop
    )
    assert process.stdout is not None
    try:
        if "ready" not in process.stdout.readline():
            raise SjerkError("the simulated drives did not start: the lines above say why")
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate()
