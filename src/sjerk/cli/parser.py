"""The parser of the command line, which also tells what it knows. Never here: verbs."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn


class _Verbs:
    """What ``add_subparsers`` gives, as far as a verb needs it."""

    def __init__(self, jobs: Any) -> None:
        self._jobs = jobs

    def add_parser(self, name: str, **words: Any) -> Any:
        job = self._jobs.add_parser(name, **({"description": words.get("help")} | words))
        job.set_defaults(verb_parser=job)  # of a verb's own verbs the innermost one stands
        return job


class Parser(argparse.ArgumentParser):
    """As of argparse; a verb's help is also the first line of its own ``--help``."""

    def add_subparsers(self, **words: Any) -> Any:
        """As of argparse, with the help of each verb as its description."""
        jobs = super().add_subparsers(**({"metavar": "verb"} | words))
        return _Verbs(jobs)

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """As of argparse; words that a verb does not know are told with that verb's usage."""
        options, rest = self.parse_known_args(args, namespace)
        if rest:
            getattr(options, "verb_parser", self).error(f"unrecognized: {' '.join(rest)}")
        return options

    def error(self, message: str) -> NoReturn:
        """As of argparse, exit code 2; the next step is its help."""
        super().error(f"{message}; `{self.prog} --help` explains")

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
