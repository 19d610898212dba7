"""Disabling in motion: axes stop as by a halt, within their limits, then lose their power."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.loops import enabled
from helpers.path_check import Array, keeps
from sjerk import Axis, Limits, MotionKernel, Trajectory, follow
from sjerk.host import MoveState, Path, PathState

T = 1e-3
AXES = 3
LIMITS = Limits(2.0, 8.0, 60.0)
T_WAY = np.linspace(0.0, 3.0, 31)
WAY = Trajectory(
    ["a", "b", "c"], T_WAY, np.sin(np.pi * T_WAY / 6.0)[:, None] ** 2 * np.array([1.0, -0.4, 0.7])
)


class Run:
    """A kernel in one of its modes of motion."""

    def __init__(self, mode: str, drive: str) -> None:
        axis = Axis(LIMITS, 1e6) if drive == "simulated" else Axis(LIMITS, 1e6, "ideal")
        self.kernel, self.host = enabled([axis] * AXES, T)
        self.path: Path | None = None
        self.rows: list[list[float]] = []
        _MODES[mode](self)

    def step(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            if self.path is not None:
                self.path.pump()
            self.kernel.step()
            self.rows.append(self.kernel.positions.tolist())

    @property
    def positions(self) -> Array:
        return np.array(self.rows)


def _path(run: Run) -> None:
    run.path = run.host.follow(follow(WAY, [LIMITS] * AXES, T))


def _paused(run: Run) -> None:
    _path(run)
    run.step(900)
    assert run.path is not None
    run.path.pause()


def _starved(run: Run) -> None:
    blocks = follow(WAY, [LIMITS] * AXES, T, block=5, lookahead=20)
    run.path = run.host.follow([next(blocks), *[None] * 10_000])


def _held(run: Run) -> None:
    run.host.move([1.0, -0.4, 0.7])
    run.step(400)
    run.host.hold()


def _slow(run: Run) -> None:
    run.host.move([1.0, -0.4, 0.7])
    run.step(300)
    run.host.override(0.4)


def _chain(run: Run) -> None:
    run.host.move([0.5, -0.2, 0.3])
    run.host.move([1.0, -0.4, 0.7], buffer="blend high")
    run.host.move([0.0, 0.0, 0.0], buffer="buffered")


_MODES: dict[str, Callable[[Run], object]] = {
    "jog": lambda run: run.host.jog([1.5, -1.0, 0.3]),
    "move": lambda run: run.host.move([1.0, -0.4, 0.7]),
    "in phase": lambda run: run.host.move([1.0, -0.4, 0.7], synchronization="phase"),
    "each by itself": lambda run: run.host.move([1.0, -0.4, 0.7], synchronization="none"),
    "chain": _chain,
    "path": _path,
    "paused": _paused,
    "starved": _starved,
    "held": _held,
    "slow": _slow,
}


@settings(max_examples=60)
@given(
    mode=st.sampled_from(sorted(_MODES)),
    drive=st.sampled_from(["ideal", "ideal", "simulated"]),
    moment=st.integers(1, 1500),
    axes=st.sampled_from([None, 0, 1, [0, 2]]),
)
def test_disable_stops_every_motion_as_a_halt_does_and_then_disables(
    mode: str, drive: str, moment: int, axes: int | list[int] | None
) -> None:
    """At any moment, bit for bit the halt of the same cycle; then no power, and nothing goes on."""
    run, twin = Run(mode, drive), Run(mode, drive)
    for each in (run, twin):
        each.step(moment)
    chosen = range(AXES) if axes is None else [axes] if isinstance(axes, int) else axes
    run.host.disable(axes=axes)
    twin.host.halt(axes=axes)
    most = 4000
    for _ in range(most):
        run.step()
        twin.step()
        seen = run.host.feedback().axes
        if not all(seen[i].follows for i in chosen):
            break
        assert run.rows[-1] == twin.rows[-1]
    for _ in range(most):
        run.step()
        if not any(run.host.feedback().axes[i].enabled for i in chosen):
            break
    keeps(twin.positions, [LIMITS] * AXES)
    near = 2e-6 if drive == "ideal" else 1e-3  # a count; or what the motor still moves by itself
    for i in chosen:
        axis = run.host.feedback().axes[i]
        assert not axis.enabled
        assert not axis.moving
        assert abs(axis.position - twin.rows[-1][i]) < near
    run.step(500)
    for i in chosen:
        assert abs(run.rows[-1][i] - twin.rows[-1][i]) < near
    if run.path is not None:
        assert run.path.state in (PathState.DONE, PathState.STOPPED, PathState.LEFT)


def test_a_jog_ends_with_its_power() -> None:
    """In a process, by the call that waits: it would go on for ever."""
    with MotionKernel([Axis(LIMITS, 1e6)], T) as kernel, kernel.host() as host:
        host.enable()
        jog = host.jog(1.0)
        jog.accepted()
        host.disable()
        assert not host.feedback().axes[0].enabled
        assert jog.state is MoveState.STOPPED


def test_enabled_again_while_it_stops_it_comes_to_rest_and_stays_enabled() -> None:
    """The stop is kept, the power too."""
    kernel, host = enabled([Axis(LIMITS, 1e6)], T)
    host.jog(1.5)
    kernel.step(600)
    host.disable()
    kernel.step(20)
    host.enable()
    kernel.step(1500)
    axis = host.feedback().axes[0]
    assert axis.enabled
    assert not axis.moving
    move = host.move(0.0)
    kernel.step(3000)
    assert move.done


@pytest.mark.parametrize("axes", [0, 1])
def test_other_axes_of_the_goal_stop_too_and_keep_their_power(axes: int) -> None:
    """As by a halt of one of them."""
    run = Run("move", "ideal")
    run.step(300)
    run.host.disable(axes=axes)
    run.step(1500)
    assert [a.enabled for a in run.host.feedback().axes] == [i != axes for i in range(AXES)]
    assert not run.host.feedback().moving
