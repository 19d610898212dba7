"""``sjerk --version``: which sjerk this is, and what it was built by. Never here: verbs."""

from __future__ import annotations

import argparse
import platform
from collections.abc import Sequence
from importlib import metadata
from typing import Any

import numpy as np

from sjerk._binding import ffi, lib


def text() -> str:
    """Version, compiler and processor of the extension, Python and numpy that run it, in one line.

    >>> text().split()[0]
    'sjerk'
    """
    build = ffi.string(lib.sj_build()).decode()
    python = f"{platform.python_implementation()} {platform.python_version()}"
    return f"sjerk {metadata.version('sjerk')} ({build}; {python}, numpy {np.__version__})"


class Version(argparse.Action):
    """Prints ``text()`` and ends; asked for only where the option is given."""

    def __init__(self, option_strings: Sequence[str], dest: str, **words: Any) -> None:
        """An option without a value."""
        super().__init__(option_strings, dest, nargs=0, **words)

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        """Print, exit code 0."""
        print(text())
        parser.exit()
