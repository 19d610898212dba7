"""The real C, cut between its atomic operations: every schedule with a few switches and kills.

Also its mutants: a line taken away or moved, which the search must notice.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from helpers.exchanges import room_text
from helpers.root import SOURCES, TESTS

STEPS = TESTS / "handshake" / "handshake_steps.c"
CC = shutil.which("cc") or shutil.which("gcc")

pytestmark = pytest.mark.skipif(CC is None, reason="no C compiler")


def build(folder: Path, mutate: tuple[str, str] | None = None) -> Path:
    """The search program around the (mutated) C."""
    text = room_text()
    if mutate:
        old, new = mutate
        # Where the formatter breaks a line does not matter.
        pattern = r"\s+".join(re.escape(word) for word in old.split())
        text, count = re.subn(pattern, lambda _: new, text)
        assert count == 1, f"the mutant no longer fits: {old!r}"
    room, program = folder / "room.c", folder / "steps"
    room.write_text(text)
    flags = [f"-I{SOURCES}", "-std=c11", "-O1"]
    tsan = [*flags, "-fsanitize=thread", "-w", "-c"]
    made = subprocess.run(
        [CC, *tsan, str(room), "-o", str(folder / "room.o")], capture_output=True, text=True
    )
    if made.returncode and mutate is None and "sanitize" in made.stderr:
        pytest.skip("the compiler has no -fsanitize=thread")
    assert made.returncode == 0, made.stderr
    subprocess.run(
        [
            CC,
            *flags,
            str(STEPS),
            str(folder / "room.o"),
            "-o",
            str(program),
        ],
        check=True,
    )
    return program


def search(program: Path, protocol: str, deviations: int) -> str:
    """What the search prints, ``runs N kills N`` or the violation."""
    done = subprocess.run(
        [str(program), protocol, str(deviations)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode in (0, 1), done
    return done.stdout


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The search program around the C as it is."""
    return build(tmp_path_factory.mktemp("steps"))


@pytest.mark.parametrize(
    ("protocol", "deviations"),
    [("command", 3), ("ring", 3), ("stop", 3), ("event", 3), ("feedback", 2)],
)
def test_no_schedule_and_no_kill_breaks_the_c(steps: Path, protocol: str, deviations: int) -> None:
    """Switching sides or killing one between any two atomic operations breaks no promise."""
    words = search(steps, protocol, deviations).split()
    assert words[0] == "runs", " ".join(words)
    assert int(words[1]) > 5000
    assert int(words[3]) > 5000


MUTANTS = {
    "the host does not mark the command fresh": (
        "command",
        ("new = word_of(old >> 2 & 3U, old & 3U, old >> 4 & 3U, 1);",
         "new = word_of(old >> 2 & 3U, old & 3U, old >> 4 & 3U, old >> 6);"),
    ),
    "the host writes into the middle slot": (
        "command",
        ("page->config.command_bytes, old & 3U);", "page->config.command_bytes, old >> 2 & 3U);"),
    ),
    "a kernel obeys commands for an earlier one": (
        "command",
        ("if (kernel_epoch < load(&k->epoch)) return 0;", ""),
    ),
    "the number is not kept in the segment": (
        "command",
        ("store(&h->published, number);", ""),
    ),
    "the latch is not marked": ("feedback", ("    store(&at->number, 0);\n", "")),
    "the latch is not looked at again": (
        "feedback",
        ("return load(&at->number) == number;", "return 1;"),
    ),
    "the count moves before the slot is whole": (
        "feedback",
        ("    store(&at->number, 0);\n",
         "    release(count, number);\n    store(&at->number, 0);\n"),
    ),
    "an event reader keeps to the slot under the pen": (
        "event",
        ("return load(&at->number) == number;", "return 1;"),
    ),
    "missed events are not counted": ("event", ("*missed += number - *cursor - 1;", "")),
    "the head moves before the records": (
        "ring",
        ("    for (uint32_t i = 0; i < count; i++) {",
         "    release(&h->head, head + count);\n    for (uint32_t i = 0; i < count; i++) {"),
    ),
    "the tail moves before the record is read": (
        "ring",
        ("        const uint64_t number = load(&at->number), host_epoch = load(&at->host_epoch);\n"
         "        const uint64_t kernel_epoch = load(&at->kernel_epoch);\n"
         "        if (kernel_epoch < epoch",
         "        release(&k->tail, tail + 1);\n"
         "        const uint64_t number = load(&at->number), host_epoch = load(&at->host_epoch);\n"
         "        const uint64_t kernel_epoch = load(&at->kernel_epoch);\n"
         "        if (kernel_epoch < epoch"),
    ),
    "records for an earlier kernel are taken": (
        "ring",
        ("if (kernel_epoch < epoch && number == tail + 1) {", "if (0) {"),
    ),
    "the tail does not move": (
        "ring",
        ("        release(&k->tail, tail + 1);\n        return 1;", "        return 1;"),
    ),
    "the kernel reads a stop and then zeroes it": (
        "stop",
        ("stop->halts = atomic_exchange_explicit(&at->halts, 0, memory_order_acq_rel);",
         "{ stop->halts = load(&at->halts); store(&at->halts, 0); }"),
    ),
    "a stop is added by a load and a store": (
        "stop",
        ("atomic_fetch_or_explicit(&at->halts, halts, memory_order_acq_rel);",
         "store(&at->halts, load(&at->halts) | halts);"),
    ),
    "a slot is claimed beside a stop that waits": (
        "stop",
        ("if (sj_stop_waits(base, index)) return 0;", ""),
    ),
    "who asked is read after the stop was taken": (
        "stop",
        ("memory_order_acq_rel);\n    return 1;",
         "memory_order_acq_rel);\n    stop->pid = load(&at->pid);\n    return 1;"),
    ),
    "a set is taken that was empty when it was asked whose it is": (
        "stop",
        ("    if (halts != 0)\n        stop->halts", "    stop->halts"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", MUTANTS)
def test_a_mutant_is_found(what: str, tmp_path: Path) -> None:
    """The search is seen to be able to fail."""
    protocol, change = MUTANTS[what]
    program = build(tmp_path, change)
    found: list[str] = []
    while len(found) < 3 and not (found and found[-1].startswith("violation")):
        found.append(search(program, protocol, len(found) + 1))
    assert found[-1].startswith("violation"), found
