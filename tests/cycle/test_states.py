"""The states of an axis: the table to be read against the one that runs."""

from __future__ import annotations

import itertools

import pytest

from sjerk._binding import lib
from sjerk.cycle.states import NEXT, AxisState, Trigger


@pytest.mark.parametrize("state", list(AxisState))
@pytest.mark.parametrize("trigger", list(Trigger))
def test_the_table_is_what_runs(state: AxisState, trigger: Trigger) -> None:
    """For every state and trigger: the same next state, or refused by both."""
    assert lib.sj_axis_next(state, trigger) == NEXT.get((state, trigger), -1)


def test_stops_and_faults_are_never_refused_and_goals_never_without_power() -> None:
    """What must always work works in each state; nothing moves in three of them."""
    for state in AxisState:
        for trigger in (Trigger.HALT, Trigger.QUICK_STOP, Trigger.FAULT, Trigger.POWER_OFF):
            assert (state, trigger) in NEXT
    goals = (Trigger.MOVE, Trigger.JOG, Trigger.SYNCHRONIZE, Trigger.HOME)
    dead = (AxisState.DISABLED, AxisState.ERROR_STOP, AxisState.STOPPING)
    assert not [pair for pair in itertools.product(dead, goals) if pair in NEXT]
    for state, trigger in itertools.product((-1, len(AxisState)), (-1, len(Trigger))):
        assert lib.sj_axis_next(state, trigger) == -1
