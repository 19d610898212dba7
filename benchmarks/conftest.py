"""Collects what the benchmarks report and prints the tables of one run at its end."""

from __future__ import annotations

from typing import Any

import pytest


class Report:
    """Lines of the closing tables, by heading."""

    def __init__(self) -> None:
        self.tables: dict[str, list[str]] = {}

    def line(self, table: str, text: str) -> None:
        """Add a line to a table."""
        self.tables.setdefault(table, []).append(text)


_key = pytest.StashKey[Report]()


def pytest_configure(config: pytest.Config) -> None:
    """One report per run."""
    config.stash[_key] = Report()


@pytest.fixture
def report(request: pytest.FixtureRequest) -> Report:
    """The tables at the end of the run."""
    return request.config.stash[_key]


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print the tables, then the ratios of benchmarks that name what they are measured against."""
    for heading, lines in config.stash[_key].tables.items():
        terminalreporter.write_sep("-", heading)
        for line in lines:
            terminalreporter.write_line(line)
    session = getattr(config, "_benchmarksession", None)
    rows = {b.name: b for b in getattr(session, "benchmarks", []) if b.stats.data}
    cost = {name: b.stats.min / b.extra_info.get("per", 1) for name, b in rows.items()}
    ratios = []
    for name, b in rows.items():
        for other, goal in b.extra_info.get("against", {}).items():
            if other in cost:
                ratios.append((name, other, cost[name] / cost[other], goal))
    if ratios:
        terminalreporter.write_sep("-", "ratios of this run (best of rounds, per item)")
        for name, other, ratio, goal in ratios:
            own, their = cost[name] * 1e9, cost[other] * 1e9
            terminalreporter.write_line(
                f"{name:34} {own:10.1f} ns  /  {other:28} {their:10.1f} ns  = {ratio:8.3f}  {goal}"
            )
