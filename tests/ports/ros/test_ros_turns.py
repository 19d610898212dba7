"""One loop for jobs of all threads."""

from __future__ import annotations

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sjerk.ports.ros.turns import Drained, Turns


def test_jobs_of_many_threads_run_in_the_loop_s_thread_in_their_order() -> None:
    """Each thread's own order is kept, and nothing runs anywhere else."""
    turns, ran = Turns(), []

    def work(name: int) -> None:
        for k in range(50):
            turns.post(lambda k=k: ran.append((name, k, threading.get_ident())))

    threads = [threading.Thread(target=work, args=(name,)) for name in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    turns.turn(0.0)
    assert {ident for *_, ident in ran} == {threading.get_ident()}
    for name in range(4):
        assert [k for of, k, _ in ran if of == name] == list(range(50))


def test_an_answer_may_come_later() -> None:
    """``ask`` waits for it in its own thread, the loop goes on; no answer is an error."""
    turns, got = Turns(), []
    ready = threading.Event()
    asks = threading.Thread(
        target=lambda: got.append(
            turns.ask(lambda answer: turns.until(ready.is_set, 60.0, answer), 60.0)
        )
    )
    asks.start()
    for _ in range(20):
        turns.turn(1e-3)
    assert not got
    ready.set()
    while asks.is_alive():
        turns.turn(1e-3)
    assert got == [True]
    with pytest.raises(TimeoutError, match="no answer within 0"):
        turns.ask(lambda answer: None, 1e-3)


def test_a_condition_that_does_not_come_is_told_as_such() -> None:
    """After its time, once."""
    turns, told = Turns(), []
    turns.until(lambda: False, 0.0, told.append)
    for _ in range(5):
        turns.turn(1e-3)
    assert told == [False]


def test_what_is_late_is_done_once() -> None:
    """A loop that was held up does not catch up."""
    turns, done = Turns(), []
    turns.every(1e-4, lambda: done.append(1))
    turns.turn(1e-2)
    turns.turn(0.0)
    first = len(done)
    held = threading.Event()
    held.wait(0.05)
    turns.turn(0.0)
    assert len(done) <= first + 1


@given(st.integers(1, 20), st.lists(st.integers(), max_size=50))
def test_a_poll_takes_all_that_came_and_the_oldest_are_dropped(depth: int, came: list[int]) -> None:
    """And counted."""
    queue = Drained(depth)
    for one in came:
        queue.put(one)
    assert queue.take() == came[-depth:]
    assert queue.lost == max(0, len(came) - depth)
    assert queue.take() == []
