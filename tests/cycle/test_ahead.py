"""The look-ahead ring and its dispatcher: what is taken, answered, dropped, corrupt."""

from __future__ import annotations

from typing import Any

from helpers.loops import enabled
from sjerk import Axis, Host, Limits, MotionKernel
from sjerk._binding import ffi, lib
from sjerk.host import EventKind

T = 1e-3
COUNTS = 2**24 / 360.0
LIMITS = Limits(90.0, 500.0, 5000.0)
NO_KIND = 77


def stepped(axes: int = 2) -> tuple[MotionKernel, Host]:
    kernel, host = enabled([Axis(LIMITS, COUNTS)] * axes, T)
    host.events()
    return kernel, host


def records(host: Host, ids: list[int], kind: int, axes: tuple[int, ...] = (0,)) -> int:
    """Publish records of one kind; the number of the last, or 0."""
    size = lib.sj_record_bytes(host.axis_count)
    room = ffi.new("char[]", len(ids) * size + ffi.sizeof("sj_record"))
    for n, goal_id in enumerate(ids):
        record: Any = ffi.cast("sj_record *", room + n * size)
        record.goal_id, record.kind = goal_id, kind
        for axis in axes:
            record.axis[axis].goal.kind = lib.SJ_GOAL_ABSOLUTE
    return host.link.publish_records(room, len(ids))


def answers(host: Host) -> list[tuple[int, int]]:
    """Goal id and result of the answers since the last look."""
    return [(e.goal_id, e.code) for e in host.events()[0] if e.kind is EventKind.GOAL]


def test_every_record_gets_one_answer_in_order_a_few_per_cycle() -> None:
    """What is no record is refused; none is taken twice, none is left, no cycle takes many."""
    kernel, host = stepped()
    ids = list(range(1, 101))
    assert records(host, ids, NO_KIND) == 100
    told: list[tuple[int, int]] = []
    for _ in range(30):
        kernel.step()
        now = answers(host)
        assert len(now) <= lib.SJ_LOOKAHEAD_TAKES
        told += now
    assert told == [(n, lib.SJ_RESULT_KIND) for n in ids]


def test_a_full_ring_takes_all_of_a_batch_or_nothing() -> None:
    """Beyond its capacity the host is told so, and nothing of the batch is seen."""
    kernel, host = stepped()
    assert records(host, list(range(1, 513)), NO_KIND) == 512
    assert records(host, [600], NO_KIND) == 0
    kernel.step(200)
    assert [n for n, _ in answers(host)] == list(range(1, 513))
    assert records(host, [600], NO_KIND) == 513


def test_a_stop_drops_what_was_given_before_it_and_nothing_else() -> None:
    """Records still in the ring too, of the stopped axes only; later ones are taken as ever."""
    kernel, host = stepped()
    records(host, list(range(1, 51)), NO_KIND, axes=(0,))
    records(host, [51], NO_KIND, axes=(1,))
    host.halt(axes=0)
    records(host, [52], NO_KIND, axes=(0,))
    kernel.step(30)
    stopped = [(n, lib.SJ_RESULT_STOPPED) for n in range(1, 51)]
    assert answers(host) == [*stopped, (51, lib.SJ_RESULT_KIND), (52, lib.SJ_RESULT_KIND)]


def test_a_newer_goal_drops_what_was_given_before_it() -> None:
    """An aborting goal clears the buffer of its axes."""
    kernel, host = stepped()
    records(host, list(range(1, 11)), NO_KIND)
    host.move({0: 1.0})
    records(host, [12], NO_KIND)
    kernel.step(10)
    told = answers(host)
    assert told[0] == (1, lib.SJ_RESULT_ACCEPTED)
    assert told[1:] == [(n, lib.SJ_RESULT_SUPERSEDED) for n in range(1, 11)] + [
        (12, lib.SJ_RESULT_KIND)
    ]


def test_a_corrupt_ring_is_reported_once_halts_and_is_emptied_by_a_reset() -> None:
    """A wild writer in a record: event, reaction, no further record until the host has acted."""
    kernel, host = stepped()
    move = host.move([60.0, 60.0])
    kernel.step(200)
    mark = 0x0123456789ABCDEF
    records(host, [mark], NO_KIND)
    memory = ffi.buffer(host.link.segment.base, host.link.segment.layout.size)
    at = bytes(memory).index(mark.to_bytes(8, "little"))
    memory[at : at + 1] = b"\x00"
    kernel.step(2000)
    told = [e for e in host.events()[0] if e.kind is EventKind.CORRUPT]
    assert [e.code for e in told] == [lib.SJ_SHM_CORRUPT_DATA]
    assert not host.feedback().moving
    assert not move.done
    records(host, [2], NO_KIND)
    kernel.step(5)
    assert answers(host) == []
    host.reset()
    kernel.step(2)
    records(host, [3], NO_KIND)
    kernel.step(2)
    assert answers(host) == [(3, lib.SJ_RESULT_KIND)]
