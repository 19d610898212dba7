"""The desk and the lead of the panel, with a kernel: what may be ordered, and by whom."""

from __future__ import annotations

import io
import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import parquet

from helpers.panel_bench import ONE, Bench, ideal_kernel
from helpers.panel_client import until
from sjerk import MotionKernel, Recorder
from sjerk.errors import InputError, SjerkError
from sjerk.host import Host, PathState
from sjerk.ports.panel.desk import AskAgainError, Desk, number, rotation, turn_of
from sjerk.ports.panel.figure import quaternion
from sjerk.ports.panel.holding import LIMIT, SILENCE, Holds, Press
from sjerk.ports.panel.inverse import UnreachableError
from sjerk.ports.panel.lead import NotLeadingError
from sjerk.ports.panel.parquet_export import parquet_of
from sjerk.ports.panel.planning import NoWayError
from sjerk.ports.panel.scope import SIGNALS, Snapshot
from sjerk.ports.panel.shapes import Shape

TWO = 2
FULL = (1.0, 1.0, 1.0)
BALL = Shape("sphere", (0.1,), (0.4, 0.3, 0.5))


@pytest.fixture(scope="module")
def kernel() -> Iterator[MotionKernel]:
    """One process for all tests here; each begins where the one before left the arm."""
    with ideal_kernel() as running:
        yield running


@pytest.fixture
def bench(kernel: MotionKernel, tmp_path: Path) -> Iterator[Bench]:
    """A desk for one test."""
    with Bench(kernel, tmp_path) as made:
        yield made


def other_goal(desk: Desk) -> list[float]:
    """The pose of those that are known that the arm is not at."""
    at = desk.commanded()
    return max(desk.poses.values(), key=lambda q: float(np.abs(np.array(q) - at).max()))  # type: ignore[return-value]


def test_the_kernel_plays_the_samples_that_were_checked(bench: Bench) -> None:
    """Bit for bit, by a recording; and arrives on the goal."""
    desk = bench.ready()
    desk.set_goal(ONE, other_goal(desk))
    with Recorder(bench.kernel.name, None) as recorder:
        proposal = desk.plan(ONE, FULL, avoid=True)
        path = desk.execute(ONE, agreed=None)
        path.wait(60.0)
        bench.rests()
    planned, played = proposal.plan.position, recorder.recording.position
    begin = int(np.flatnonzero((played == planned[1]).all(axis=1))[0])
    assert (played[begin : begin + len(planned) - 1] == planned[1:]).all()
    assert desk.commanded().tolist() == desk.goal.tolist()
    assert not proposal.plan.collides
    assert proposal.plan.shares.max() == pytest.approx(1.0, abs=0.02)
    assert proposal.plan.shares.max() <= 1.0 + 1e-9


def test_a_plan_is_refused_once_the_arm_or_the_scene_has_changed(bench: Bench) -> None:
    """With how far, and by whom."""
    desk = bench.ready()
    with pytest.raises(NotLeadingError, match="nothing is planned"):
        desk.execute(ONE, agreed=None)
    desk.set_goal(ONE, other_goal(desk))
    desk.plan(ONE, FULL, avoid=True)
    bench.lead.of(ONE).move({6: 0.01}, relative=True).wait(30.0)
    with pytest.raises(NotLeadingError, match=r"panda_joint7 has moved since by 0.01 rad"):
        desk.execute(ONE, agreed=None)
    desk.plan(ONE, FULL, avoid=True)
    desk.set_shape(ONE, "far", replace(BALL, centre=(3.0, 0.0, 0.5)))
    with pytest.raises(NotLeadingError, match="the scene has changed"):
        desk.execute(ONE, agreed=None)
    assert not bench.moves


def test_a_plan_that_collides_needs_a_second_click_and_is_written_down(bench: Bench) -> None:
    """And without it nothing moves."""
    desk = bench.ready()
    desk.set_goal(ONE, other_goal(desk))
    x, y, z = desk.arm.tip(desk.goal)[0, :3, 3]  # type: ignore[union-attr]
    desk.set_shape(ONE, "wall", Shape("sphere", (0.05,), (float(x), float(y), float(z))))
    with pytest.raises(NoWayError, match=r"goal leaves less than 20 mm: .* touches wall"):
        desk.plan(ONE, FULL, avoid=True)
    proposal = desk.plan(ONE, FULL, avoid=False)
    assert proposal.plan.collides
    with pytest.raises(AskAgainError, match="click again"):
        desk.execute(ONE, agreed=None)
    assert not bench.moves
    path = desk.execute(ONE, agreed=proposal)
    path.wait(60.0)
    assert "executes a plan that collides" in bench.journal.html()


def test_only_the_browser_that_leads_may_order(bench: Bench) -> None:
    """The second one is told who does."""
    desk = bench.ready()
    with pytest.raises(NotLeadingError, match="browser 1 leads"):
        bench.lead.take(TWO)
    orders: list[Callable[[], object]] = [
        lambda: desk.set_goal(TWO, [0.0] * 7),
        lambda: desk.go_to_pose(TWO, "ready"),
        lambda: desk.save_pose(TWO, "mine"),
        lambda: desk.set_shape(TWO, "ball", BALL),
        lambda: desk.save_scene(TWO),
        lambda: desk.reach(TWO, (0.3, 0.0, 0.5)),
        lambda: desk.plan(TWO, FULL, avoid=True),
        lambda: desk.execute(TWO, agreed=None),
        lambda: desk.record(TWO),
        lambda: bench.lead.jog(TWO, 0, 0.1),
        lambda: bench.lead.keep(TWO),
        lambda: bench.lead.speed(TWO, 1.0),
    ]
    for order in orders:
        with pytest.raises(NotLeadingError, match="does not lead"):
            order()
    bench.lead.give_back(TWO, "it never had it")
    assert bench.lead.browser == ONE
    bench.lead.give_back(ONE, "given back")
    bench.lead.take(TWO)
    assert bench.lead.browser == TWO


def test_another_process_that_leads_is_named(bench: Bench) -> None:
    """By its number."""
    with bench.kernel.host(), pytest.raises(NotLeadingError, match=r"process \d+ leads"):
        bench.lead.take(ONE)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e9, "1", None, True, [0.0]])
def test_values_that_are_none_are_refused(bench: Bench, value: Any) -> None:
    """Each number of a browser, before anything moves."""
    desk = bench.ready()
    goal = desk.commanded().tolist()
    orders: list[Callable[[], object]] = [
        lambda: desk.set_goal(ONE, [*goal[:6], value]),
        lambda: desk.plan(ONE, (0.5, value, 0.5), avoid=True),
        lambda: desk.reach(ONE, (0.3, value, 0.5)),
        lambda: desk.go_to_pose(ONE, value),
        lambda: number("step", value, 0.0, 1e6),
    ]
    if not isinstance(value, str):
        orders += [
            lambda: desk.save_pose(ONE, value),
            lambda: desk.set_shape(ONE, value, BALL),
        ]
    for order in orders:
        with pytest.raises(InputError):
            order()
    assert desk.goal.tolist() == goal
    assert not bench.moves


def test_a_name_that_is_code_is_refused(bench: Bench) -> None:
    """Names stand in the pages of all."""
    desk = bench.ready()
    for name in ("<script>", "a" * 33, "", " a", "a\n", "'; --"):
        with pytest.raises(InputError, match="letters"):
            desk.set_shape(ONE, name, BALL)


def held(bench: Bench, axis: int, velocity: float) -> None:
    """Press a button until it moves; where the machine was busy and it was cut, press again."""

    def moves() -> bool:
        for _ in range(10):
            bench.lead.jog(ONE, axis, velocity)
            if bench.moves:
                return True
            time.sleep(0.02)
        bench.lead.release(ONE, axis)
        return False

    until(moves, "moves")


def test_a_jog_moves_while_held_and_rests_when_let_go(bench: Bench) -> None:
    """By its release."""
    bench.ready()
    before = bench.desk.commanded()
    held(bench, 6, -0.3)
    bench.lead.release(ONE, 6)
    bench.rests()
    assert (bench.desk.commanded()[:6] == before[:6]).all()
    assert bench.desk.commanded()[6] < before[6]


def test_a_held_button_that_gives_no_sign_is_let_go_and_needs_a_fresh_press(bench: Bench) -> None:
    """Messages once in a second, of a window in the background, begin nothing."""
    bench.ready()
    held(bench, 6, 0.3)
    until(lambda: "gave no sign" in bench.journal.html(), "cut")
    bench.rests()
    at = bench.desk.commanded()
    for _ in range(3):
        bench.lead.jog(ONE, 6, 0.3)
        time.sleep(0.2)
    assert (bench.desk.commanded() == at).all()
    bench.lead.release(ONE, 6)
    held(bench, 6, -0.3)
    bench.lead.release(ONE, 6)


def test_hold_to_run_rests_on_the_path_and_goes_on(bench: Bench) -> None:
    """To the goal, to the last bit."""
    desk = bench.ready()
    desk.set_goal(ONE, other_goal(desk))
    desk.plan(ONE, (0.3, 0.3, 0.3), avoid=True)
    assert bench.lead.keep(ONE) is Press.BEGINS  # the message of the press comes first
    path = desk.execute(ONE, agreed=None, hold=True)
    until(lambda: path.state is PathState.PAUSED, "no sign: paused")
    assert path.progress.point == 0 or not path.done
    bench.lead.let_go(ONE)

    def over() -> bool:
        if bench.lead.keep(ONE) is Press.CUT:
            bench.lead.let_go(ONE)
        return path.state.ended

    until(over, "at its end")
    assert path.done
    assert desk.commanded().tolist() == desk.goal.tolist()


def test_anybody_may_stop_and_the_second_press_is_a_quick_stop(bench: Bench) -> None:
    """Whoever leads; a held button needs a fresh press then."""
    bench.ready()
    held(bench, 6, -0.3)
    assert bench.lead.stop() == "halt"
    assert bench.lead.stop() == "quick stop"
    bench.rests()
    bench.lead.jog(ONE, 6, -0.3)
    time.sleep(0.1)
    assert not bench.moves
    assert bench.lead.browser == ONE


def test_what_was_ordered_before_a_stop_does_not_begin_after_it(bench: Bench) -> None:
    """A plan that took its time, and a motion that is commanded beside the stop."""
    desk = bench.ready()
    desk.set_goal(ONE, other_goal(desk))
    stops = bench.lead.stops
    desk.plan(ONE, FULL, avoid=True)
    bench.lead.stop()
    with pytest.raises(NotLeadingError, match="a stop came in between"):
        desk.execute(ONE, agreed=None, stops=stops)
    assert not bench.moves

    def beside(host: Host) -> None:
        bench.lead.stop()
        host.jog({6: -0.1})

    at = desk.commanded()
    with pytest.raises(NotLeadingError, match="a stop came in between"):
        bench.lead.order(ONE, beside)
    bench.rests()
    assert np.abs(desk.commanded() - at).max() < 0.1
    desk.plan(ONE, FULL, avoid=True)
    desk.execute(ONE, agreed=None, stops=bench.lead.stops).wait(60.0)


@pytest.mark.parametrize("seed", range(6))
def test_a_stop_ends_a_held_jog_at_whatever_moment_it_comes(bench: Bench, seed: int) -> None:
    """Also between the message of the press and its motion; a hand that goes on is cut."""
    bench.ready()
    over, begun = threading.Event(), threading.Event()

    def hold() -> None:
        while not over.wait(0.0005):
            bench.lead.jog(ONE, 6, -0.2 if seed % 2 else 0.2)
            begun.set()

    hand = threading.Thread(target=hold)
    hand.start()
    try:
        begun.wait(60.0)
        time.sleep(np.random.default_rng(seed).uniform(0.0, 0.005))
        bench.lead.stop()
        bench.lead.let_all_go()
        bench.rests()
        at = bench.desk.commanded()
        over.wait(0.05)  # held all the time
        assert (bench.desk.commanded() == at).all()
    finally:
        over.set()
        hand.join()
        bench.lead.release(ONE, 6)


def test_what_a_browser_started_does_not_outlive_it(bench: Bench) -> None:
    """It leaves in the middle of a path, and of a recording."""
    desk = bench.ready()
    desk.set_goal(ONE, other_goal(desk))
    desk.plan(ONE, (0.3, 0.3, 0.3), avoid=True)
    assert "records to" in desk.record(ONE)
    ends: list[str] = []
    desk.execute(ONE, agreed=None, then=ends.append)
    until(lambda: bench.moves, "in motion")
    desk.left(ONE, "its page was closed")
    bench.rests()
    assert desk.commanded().tolist() != desk.goal.tolist()
    assert bench.lead.browser is None
    until(lambda: ends, "told")
    assert ends[0]
    assert [file.suffix for file in desk.folder.iterdir()] == [".parquet"]
    with bench.kernel.host() as host:
        host.halt()


def test_a_pose_of_the_flange_becomes_the_goal(bench: Bench) -> None:
    """And what cannot be reached leaves it as it was."""
    desk = bench.ready()
    desk.reach(ONE, (0.4, 0.1, 0.5))
    assert desk.arm is not None
    assert desk.arm.tip(desk.goal)[0, :3, 3] == pytest.approx([0.4, 0.1, 0.5], abs=1e-5)
    before = desk.goal
    with pytest.raises(UnreachableError):
        desk.reach(ONE, (2.0, 0.0, 0.5))
    assert desk.goal is before


def test_the_scope_has_every_cycle(bench: Bench) -> None:
    """Its peaks are those of the trace."""
    bench.ready()
    held(bench, 5, 0.2)
    bench.lead.release(ONE, 5)
    bench.rests()
    assert bench.watching.feedback() is not None
    scope = bench.watching.scope
    assert scope is not None
    whole = scope.snapshot(list(range(7)))
    assert (np.diff(whole.cycles.astype(int)) == 1).all() or scope.missed
    peak = whole.rows[:, 5, SIGNALS.index("velocity")].max()
    assert peak > 0.0
    assert np.nanmax(scope.drawn(5, "velocity")) == pytest.approx(peak, abs=1e-9)
    newer = scope.snapshot([5], after=int(whole.cycles[40]))
    assert newer.cycles.tolist() == whole.cycles[41:].tolist()
    assert (newer.rows[:, 0] == whole.rows[41:, 5]).all()


@given(
    st.integers(0, 3000),
    st.integers(1, 2**40),
    st.floats(-9.0, 0.0),
    st.floats(0.0, 9.0),
    st.sampled_from([5e-4, 1e-3, 2e-3, 1 / 3]),
    st.integers(2, 600),
)
def test_what_is_seen_is_what_is_saved(
    count: int, first: int, begin: float, length: float, cycle_time: float, most: int
) -> None:
    """The cycles of those seconds, each once, to the last bit; no peak of them is left out."""
    random = np.random.default_rng(count)
    cycles = np.arange(first, first + count, dtype=np.uint64)
    late = np.cumsum(random.uniform(size=count) < 0.1)  # a late clock leaves some out
    stamps = ((np.arange(count) + late) * round(1e9 * cycle_time) + 10**12).astype(np.int64)
    rows = random.normal(size=(count, 2, len(SIGNALS)))
    end = min(0.0, begin + length)
    seen = Snapshot(cycles, stamps, rows, cycle_time).between(begin, end)
    before = (stamps - stamps[-1:]) * 1e-9
    surely = (before >= begin) & (before <= end)
    perhaps = (before > begin - cycle_time) & (before < end + cycle_time)
    assert set(cycles[surely].tolist()) <= set(seen.cycles.tolist())
    assert set(seen.cycles.tolist()) <= set(cycles[perhaps].tolist())
    columns = seen.columns(["a,b", "c"])
    text = seen.csv(["a,b", "c"]).decode().splitlines()
    table = parquet.read_table(io.BytesIO(parquet_of(columns))).to_pydict()
    assert list(table) == list(columns)
    assert len(text) == len(seen.cycles) + 1
    assert all(row.count(",") == len(columns) - 1 for row in text)
    for k, (name, values) in enumerate(columns.items()):
        assert table[name] == values.tolist()
        assert [float(row.split(",")[k]) for row in text[1:]] == values.tolist()
    assert columns["c jerk"].tolist() == seen.rows[:, 1, SIGNALS.index("jerk")].tolist()
    at, drawn = seen.drawn(1, "jerk", origin=10**12, most=most)
    assert len(at) == len(drawn) <= max(most, 1)
    if len(seen.cycles):
        assert drawn.max() == columns["c jerk"].max()
        assert drawn.min() == columns["c jerk"].min()
        assert (np.diff(at) >= 0.0).all()


def test_saving_into_the_robot_that_is_shipped_is_refused(bench: Bench) -> None:
    """With what to do."""
    desk = bench.ready()
    with pytest.raises(SjerkError, match="copy its file"):
        desk.save_pose(ONE, "mine")
    assert "mine" not in desk.poses


@given(st.lists(st.tuples(st.sampled_from("mrt"), st.floats(0.0, 1.0)), max_size=40))
def test_a_hold_is_never_longer_than_its_messages(steps: list[tuple[str, float]]) -> None:
    """Random messages, releases and looks: a button counts as held only close to a message."""
    holds, now, last, cut = Holds(), 0.0, -math.inf, False
    for what, wait in steps:
        now += wait
        if what == "m":
            press = holds.message("x", now)
            if cut and now - last < SILENCE:
                assert press is Press.CUT
            cut = press is Press.CUT
            last = now
        elif what == "r":
            holds.release("x")
            cut = False
        elif holds.expired(now):
            assert now - last > LIMIT
            cut, last = True, now
        if what == "t" and holds.holds("x"):
            assert now - last <= LIMIT


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_angles_and_quaternions_say_the_same_rotation(turn: tuple[float, float, float]) -> None:
    """By a product that is written out."""
    R = rotation(turn)
    assert np.abs(rotation(turn_of(R)) - R).max() < 1e-7
    w, x, y, z = quaternion(R)
    again = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    assert np.abs(np.array(again) - R).max() < 1e-12
