"""Exhaustive search: no run of the protocols, with a kill at any step, breaks their promise."""

from __future__ import annotations

import pytest

from helpers.handshake_models import (
    LEGAL,
    Command,
    Exchange,
    Latch,
    Ring,
    Stops,
    ViolationError,
    collected,
    command_successors,
    command_wrong,
    exchange_successors,
    explore,
    latch_successors,
    latch_wrong,
    published,
    ring_successors,
    ring_wrong,
    stop_successors,
    stop_wrong,
)
from sjerk._binding import ffi, lib
from sjerk.handshake import Layout, Segment

LAYOUT = Layout(command_bytes=8, feedback_bytes=8)


# ---- the models ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("most", "kills"), [(4, 1), (3, 2)])
def test_no_run_of_the_command_word_tears_loses_or_goes_back(most: int, kills: int) -> None:
    """Whoever is killed at whichever step: commands are whole, in order, for this kernel."""
    assert explore(Command(), command_successors(most, kills), command_wrong) > 1000


def test_no_run_of_the_latch_tears_or_hides_the_newest_frame() -> None:
    """A writer killed at any step leaves the newest frame readable."""
    assert explore(Latch(), latch_successors(5, 2), latch_wrong) > 1000


@pytest.mark.parametrize(("most", "kills"), [(4, 1), (2, 2)])
def test_no_run_of_the_ring_tears_loses_or_doubles(most: int, kills: int) -> None:
    """Records come whole, in order, once; only flushed and misaddressed ones are left out."""
    assert explore(Ring(), ring_successors(most, kills), ring_wrong) > 1000


@pytest.mark.parametrize(("most", "kills"), [(3, 1), (2, 2)])
def test_no_run_of_the_stop_requests_loses_doubles_or_misnames(most: int, kills: int) -> None:
    """Whoever is killed at whichever step: each request is taken once, with who asked."""
    assert explore(Stops(), stop_successors(most, kills), stop_wrong) > 1000


# ---- the search can fail ------------------------------------------------------------------------


def test_private_indices_tear_after_a_restart() -> None:
    """The exchange that keeps its indices to itself is found out within 12 steps."""
    with pytest.raises(ViolationError, match="torn") as caught:
        explore(Exchange(), exchange_successors, lambda s: s.bad or None)
    assert caught.value.steps <= 12


def test_a_kernel_that_clears_after_its_epoch_loses_a_command() -> None:
    """The order of the two stores of a restart matters."""
    with pytest.raises(ViolationError, match="lost"):
        explore(Command(), command_successors(2, 1, clear_last=True), command_wrong)


def test_without_the_stamp_a_new_kernel_obeys_a_command_for_the_old() -> None:
    """Clearing `fresh` alone does not keep a late command away from the new kernel."""
    with pytest.raises(ViolationError, match="meant for another kernel"):
        explore(Command(), command_successors(2, 1, stamped=False), command_wrong)


def test_a_latch_without_its_mark_tears() -> None:
    """The 0 before the payload is what protects a reader that is overtaken."""
    with pytest.raises(ViolationError, match="torn"):
        explore(Latch(), latch_successors(5, 1, mark=False), lambda s: s.bad or None)


def test_a_flush_by_counter_alone_loses_later_records() -> None:
    """A flush must say how far it reaches."""
    with pytest.raises(ViolationError, match="lost"):
        explore(Ring(), ring_successors(4, 0, mark=False), ring_wrong)


def test_without_the_stamp_a_new_kernel_takes_records_for_the_old() -> None:
    """Moving the tail alone does not keep a late batch away from the new kernel."""
    with pytest.raises(ViolationError, match="meant for another kernel"):
        explore(Ring(), ring_successors(3, 1, stamped=False), ring_wrong)


@pytest.mark.parametrize(
    ("twin", "what"),
    [
        ({"atomic": False}, "doubled"),
        ({"exchanged": False}, "lost"),
        ({"patient": False}, "told of another process"),
        ({"named_first": False}, "told of another process"),
        ({"only_seen": False}, "told of another process"),
    ],
)
def test_a_broken_twin_of_the_stop_requests_is_found(twin: dict[str, bool], what: str) -> None:
    """A set that is loaded and stored, one that is read and zeroed, a claim that does not
    wait, a name that is read too late, a set taken in another's name.
    """
    with pytest.raises(ViolationError, match=what):
        explore(Stops(), stop_successors(3, 1, **twin), stop_wrong)


# ---- the C takes the same steps -----------------------------------------------------------------


def poke(segment: Segment, value: int | None = None) -> int:
    """The command word in memory, after setting it."""
    at = ffi.cast("uint32_t *", ffi.cast("char *", segment.base) + lib.SJ_SHM_COMMAND)
    if value is not None:
        at[0] = value
    return int(at[0])


@pytest.mark.parametrize("value", sorted(LEGAL))
def test_the_c_takes_the_word_transitions_of_the_model(value: int) -> None:
    """From each of the twelve words, publish and collect lead where the model says."""
    with Segment.private(LAYOUT) as segment:
        poke(segment, value)
        assert lib.sj_command_publish(segment.base, b"01234567") == 0
        assert poke(segment) == published(value)
    with Segment.private(LAYOUT) as segment:
        poke(segment, value)
        lib.sj_command_collect(segment.base, ffi.new("char[8]"))
        assert poke(segment) == collected(value)
    with Segment.private(LAYOUT) as segment:
        poke(segment, value)
        lib.sj_shm_begin_kernel(segment.base, 0)
        assert poke(segment) == value & ~64


def test_every_other_word_is_corruption_and_left_as_it_is() -> None:
    """The C refuses all but twelve words, and touches none of the others."""
    with Segment.private(LAYOUT) as segment:
        out = ffi.new("char[8]")
        for value in [*range(256), 1 << 8, 1 << 16, 1 << 31, 0xFFFFFFFF]:
            if value not in LEGAL:
                poke(segment, value)
                assert lib.sj_command_publish(segment.base, b"x" * 8) == lib.SJ_SHM_CORRUPT_WORD
                assert lib.sj_command_collect(segment.base, out) == lib.SJ_SHM_CORRUPT_WORD
                assert poke(segment) == value
