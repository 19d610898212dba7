"""The parser of the command line, which also tells what it knows. Never here: verbs."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any


class _Verbs:
    """What ``add_subparsers`` gives, as far as a verb needs it."""

    def __init__(self, jobs: Any) -> None:
        self._jobs = jobs

    def add_parser(self, name: str, **words: Any) -> Any:
        return self._jobs.add_parser(name, **({"description": words.get("help")} | words))


class Parser(argparse.ArgumentParser):
    """As of argparse; a verb's help is also the first line of its own ``--help``."""

    def add_subparsers(self, **words: Any) -> Any:
        """As of argparse, with the help of each verb as its description."""
        jobs = super().add_subparsers(**words)
        return _Verbs(jobs)

    @property
    def arguments(self) -> list[argparse.Action]:
        """What it takes, in order: options and the rest."""
        return list(self._actions)

    @property
    def verbs(self) -> Mapping[str, Parser]:
        """The parsers of its verbs by name; none where it has no verbs.

        >>> Parser().verbs
        {}
        """
        for action in self._actions:
            if isinstance(action.choices, Mapping):
                return action.choices
        return {}
