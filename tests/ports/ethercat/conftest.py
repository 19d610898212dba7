"""Tells how many cases of the conformance tables have run, and how many differ."""

from __future__ import annotations

import pytest

#: Tables written from the rules, in virtual time, and what they are about.
TABLES = {
    "test_ethercat_states.py": "states",
    "test_ethercat_datagrams.py": "datagrams, FMMUs, buffers",
    "test_ethercat_coe.py": "mailbox, SDO",
    "test_ethercat_clocks.py": "clocks, watchdog",
    "test_ethercat_files.py": "SII, ESI",
}


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """One line, where any of them ran."""
    counts, different = dict.fromkeys(TABLES, 0), 0
    for outcome in ("passed", "failed"):
        for report in terminalreporter.stats.get(outcome, ()):
            name = report.nodeid.partition("::")[0].rpartition("/")[2]
            if name in counts and report.when == "call":
                counts[name] += 1
                different += outcome == "failed"
    if sum(counts.values()):
        parts = ", ".join(f"{TABLES[name]} {count}" for name, count in counts.items() if count)
        terminalreporter.write_line(
            f"EtherCAT conformance: {sum(counts.values())} cases ({parts}), {different} differences"
        )
