"""The C under ThreadSanitizer: host, kernel, monitors, a listener, two that stop, at full speed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from helpers.exchanges import room_text
from helpers.root import SOURCES, STRESS

CC = shutil.which("cc") or shutil.which("gcc")


def hammer(folder: Path, room: str) -> subprocess.CompletedProcess[str]:
    """Build the hammer around this text of the dual-port RAM and run it; skip without TSan."""
    if CC is None:
        pytest.skip("no C compiler")
    (folder / "room.c").write_text(room)
    program = folder / "hammer"
    flags = ["-std=c11", "-O2", "-g", "-w", "-fsanitize=thread", "-pthread", f"-I{SOURCES}"]
    empty = folder / "empty.c"
    empty.write_text("int main(void) { return 0; }\n")
    tried = subprocess.run([CC, *flags, str(empty), "-o", str(program)], capture_output=True)
    if tried.returncode or subprocess.run([program], capture_output=True).returncode:
        pytest.skip("ThreadSanitizer does not build or run here")
    source = STRESS / "handshake_peer.c"
    files = [str(source), str(folder / "room.c"), "-o", str(program)]
    subprocess.run([CC, *flags, "-DPEER_THREADS", *files], check=True)
    return subprocess.run(
        [program, "2000"],
        capture_output=True,
        text=True,
        env={**os.environ, "TSAN_OPTIONS": "halt_on_error=1"},
        timeout=120,
    )


def test_there_is_no_data_race(tmp_path: Path) -> None:
    """No plain access beside a concurrent one, nothing torn, in any of the five exchanges."""
    done = hammer(tmp_path, room_text())
    assert "data race" not in done.stderr, done.stderr[:2000]
    assert done.returncode == 0, done.stdout + done.stderr[:2000]
    words = done.stdout.split()
    counts = dict(zip(words[::2], map(int, words[1::2]), strict=True))
    assert counts["sent"] == 4000
    assert min(counts["collected"], counts["frames"], counts["events"], counts["stops"]) > 0
    assert counts["wrong"] == 0


def test_a_plain_store_is_found(tmp_path: Path) -> None:
    """With a payload copied by plain stores the sanitizer speaks: it is awake."""
    text = room_text()
    plain = re.sub(
        r"store\(&(\w+\[\w+\]), bytes_to_word\(",
        r"*(uint64_t *)(uintptr_t)&\1 = (bytes_to_word(",
        text,
    )
    assert plain != text
    done = hammer(tmp_path, plain)
    assert done.returncode != 0
    assert "data race" in done.stderr
