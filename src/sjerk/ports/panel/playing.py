"""Trajectories: files that are played through ``TrajectoryExecutor``, with its settings.

Never here: following, reading files.
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sjerk.errors import InputError, SjerkError
from sjerk.executor import GoalHandle, GoalStatus, TrajectoryExecutor
from sjerk.executor.goal import OPEN
from sjerk.ports.panel.desk import number
from sjerk.trajectory import ExecutionMode, Trajectory, resample

if TYPE_CHECKING:
    from sjerk.ports.panel.page import Page

_NONE = "(no file)"
_MOST = 100


def files(folder: Path) -> dict[str, Path]:
    """Trajectories in a folder by name: CSV files and bags, the newest names first."""
    if not folder.is_dir():
        return {}
    found = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in (".csv", ".mcap", ".db3")]
    found += [p for p in sorted(folder.iterdir()) if (p / "metadata.yaml").is_file()]
    return {path.name: path for path in found[:_MOST]}


class PlayTab:
    """Of one browser; it may choose among the files of the panel's folder, and nothing else."""

    def __init__(self, page: Page, gui: Any) -> None:
        self._page, self._desk = page, page.desk
        self._files = files(self._desk.folder)
        self._trajectory: Trajectory | None = None
        self._executor: TrajectoryExecutor | None = None
        self._goal: GoalHandle | None = None
        self._drawing = threading.Lock()
        self._file = gui.add_dropdown("File", tuple(self._files) or (_NONE,))
        modes = tuple(mode.value for mode in ExecutionMode)
        every = ExecutionMode.FULL_TRAJECTORY.value
        self._mode = gui.add_dropdown("Mode", modes, initial_value=every, hint="execution_mode")
        self._delta = gui.add_number(
            "Delta", 0.0, step=0.001, hint="resampling_delta, axis units; 0: every point"
        )
        self._act = gui.add_button_group("File", ("Show", "Reload"))
        self._joint = gui.add_dropdown("Joint", tuple(self._desk.names))
        flat, ends = np.zeros(2), np.array([0.0, 1.0])
        self._plot = gui.add_uplot(
            (ends, flat, flat),
            (
                {"label": "s"},
                {"label": "points", "stroke": "#868e96", "width": 1, "points": {"show": False}},
                {
                    "label": "kept",
                    "stroke": "#fd7e14",
                    "width": 1,
                    "spanGaps": True,
                    "points": {"show": True, "size": 5},
                },
            ),
            title="points before and after resampling",
            height=170,
            padding=(10, 24, 0, 0),
            scales={"x": {"time": False}, "y": {"auto": True}},
            legend={"show": False},
        )
        self._told = gui.add_html("")
        self._start = gui.add_button("Go to its start")
        self._play = gui.add_button("Play", color="green")
        self._cancel = gui.add_button("Cancel: rest on the path")
        self._errors = gui.add_button("Acknowledge errors", hint="reset of faults")
        self._act.on_click(lambda _: page.do(self._acted))
        for one in (self._joint, self._delta, self._mode):
            one.on_update(lambda _: page.do(self._draw))
        self._start.on_click(lambda _: page.do(self._gone_to_start))
        page.on_press(self._play, self._played)
        self._cancel.on_click(lambda _: page.do(self._cancelled))
        self._errors.on_click(lambda _: page.do(self._acknowledged))
        self.locked = [self._start, self._play, self._cancel, self._errors]

    # ---- the file

    def _acted(self) -> None:
        self._files = files(self._desk.folder)
        names = tuple(self._files) or (_NONE,)
        if tuple(self._file.options) != names:
            self._file.options = names
        if self._act.value == "Show":
            self._read()
            self._draw()

    def _read(self) -> Trajectory:
        path = self._files.get(str(self._file.value))
        if path is None:
            raise InputError("file", self._file.value, f"is none of {self._desk.folder}")
        read = Trajectory.from_csv if path.suffix.lower() == ".csv" else Trajectory.from_bag
        found = read(path)
        names = self._desk.names
        if set(found.joint_names) != set(names):
            if len(found.joint_names) != len(names):
                known = ", ".join(found.joint_names)
                raise InputError("file", path.name, f"has {known}; the robot {', '.join(names)}")
            found = Trajectory(
                names, found.time, found.position, found.velocity, found.acceleration
            )
        self._trajectory = found.for_joints(names)
        return self._trajectory

    def _kept(self, trajectory: Trajectory) -> Any:
        """The points that are played, in the mode and with the delta of this page."""
        position = trajectory.position
        assert position is not None
        if self._mode.value == ExecutionMode.SINGLE_POINT.value:
            return np.array([len(position) - 1])
        delta = number("delta", self._delta.value, 0.0, 1e6)
        return resample(position, delta) if delta > 0.0 else np.arange(len(position))

    def _draw(self) -> None:
        with self._drawing:  # what was chosen last is drawn last
            self._drawn()

    def _drawn(self) -> None:
        trajectory = self._trajectory
        if trajectory is None:
            return
        kept = self._kept(trajectory)
        name = str(self._joint.value)
        i = self._desk.names.index(name) if name in self._desk.names else 0
        position = np.asarray(trajectory.position)[:, i]
        after = np.full(len(position), np.nan)
        after[kept] = position[kept]
        self._plot.data = (np.asarray(trajectory.time), position, after)
        self._told.content = (
            "<div class='sjerk-points' style='padding:0 10px;font-size:12px'>"
            f"{len(position)} points, {len(kept)} after resampling, "
            f"{trajectory.duration:.3f} s</div>"
        )

    # ---- orders

    def _gone_to_start(self) -> None:
        trajectory = self._trajectory or self._read()
        self._desk.set_goal(self._page.browser, np.asarray(trajectory.position)[0].tolist())
        self._page.plan.show_goal()
        self._page.say("the goal is the first point: plan and execute in Plan")

    def _played(self, stops: int) -> None:
        desk, page = self._desk, self._page
        host = desk.lead.of(page.browser)
        trajectory = self._read()
        self._draw()
        self._end()
        executor = TrajectoryExecutor(host, desk.names, on_result=self._over)
        self._executor = executor
        desk.lead.use(executor.close)
        executor.change(
            execution_mode=str(self._mode.value),
            resampling_delta=number("delta", self._delta.value, 0.0, 1e6),
            allow_end_velocity=True,
        )
        desk.lead.check_stops(stops)
        self._goal = executor.submit(trajectory)
        if desk.lead.stops != stops:  # one came beside it
            self._goal.cancel()
            desk.lead.check_stops(stops)
        if self._goal.status is GoalStatus.REJECTED:
            raise SjerkError(f"refused: {self._goal.text}")
        page.say("in motion")

    def _over(self, goal: GoalHandle) -> None:
        self._page.say(
            f"{goal.status.value}: {goal.text}" if goal.text else goal.status.value,
            bad=goal.status is not GoalStatus.SUCCEEDED,
        )

    def _cancelled(self) -> None:
        self._desk.lead.of(self._page.browser)
        if self._goal is None or self._goal.status not in OPEN:
            raise SjerkError("nothing is played")
        self._goal.cancel()

    def _acknowledged(self) -> None:
        self._desk.lead.reset(self._page.browser)
        self._page.say("errors are acknowledged")

    def _end(self) -> None:
        executor, self._executor = self._executor, None
        if executor is not None:
            executor.close()

    def tick(self) -> None:
        """Progress of what is played; nothing is watched once its browser leads no longer."""
        goal = self._goal
        if self._executor is not None and self._desk.lead.browser != self._page.browser:
            self._end()
        if goal is not None and goal.status not in OPEN:
            self._end()
        if goal is None or goal.status not in OPEN or goal.feedback is None:
            return
        worst = float(np.abs(goal.feedback.error).max())
        self._page.say(
            f"point {goal.feedback.point + 1} of {len(goal.trajectory)}, "
            f"speed {100 * goal.feedback.speed:.0f} %, error {worst:.2g}"
        )
