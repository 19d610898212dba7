"""Recordings as files: Parquet or MCAP by the suffix, extra ``record``.

What goes in and comes out are columns and a text. Never here: what a column means, and what a file
of either kind looks like inside.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from sjerk.errors import ConfigError, ExtraMissingError, InputError
from sjerk.extras import load
from sjerk.recording.tables import Tables

#: The module that reads and writes a kind of file, and the prefix of its classes.
_KINDS = {
    ".parquet": ("sjerk.recording.parquet", "Parquet"),
    ".mcap": ("sjerk.recording.mcap", "Mcap"),
}


class TableWriter(Protocol):
    """Takes tables of consecutive cycles, in order."""

    def write(self, tables: Tables) -> None:
        """Append; every call has the same tables and columns."""

    def close(self) -> None:
        """End the file."""


def ready(path: Path) -> None:
    """Load what a file of this suffix needs; raises InputError, ExtraMissingError."""
    _class(path, "Writer")


def writer(path: Path, description: str) -> TableWriter:
    """A writer by the suffix of the file; raises InputError."""
    made: TableWriter = _class(path, "Writer")(path, description)
    return made


@contextmanager
def decoding(path: Path) -> Iterator[None]:
    """Around all that is made of the bytes of a file: every fault of theirs names the file.

    Decoders meet damaged bytes with exceptions of any type, so any but those that are known to be
    of something else becomes an InputError of ``file``.
    """
    try:
        yield
    except (ConfigError, ExtraMissingError):
        raise
    except InputError as fault:
        if fault.field == "file":
            raise
        raise InputError("file", str(path), f"is damaged: {fault}") from fault
    except Exception as fault:
        if isinstance(fault, OSError) and fault.errno is not None:  # of the system, not of pyarrow
            raise
        why = f"is damaged: {type(fault).__name__}: {_line(fault)}"
        raise InputError("file", str(path), why) from fault


def _line(fault: Exception) -> str:
    return str(fault).partition("\n")[0]


def reader(path: Path) -> TableReader:
    """A reader by the suffix of the file; raises InputError, OSError.

    To be used within ``decoding``.
    """
    if not path.exists():
        raise InputError("file", str(path), "does not exist")
    made: TableReader = _class(path, "Reader")(path)
    return made


class TableReader(Protocol):
    """Gives the tables of a file back, in order, some thousand cycles at a time."""

    description: str

    def tables(self) -> Iterator[Tables]:
        """All of them, from the beginning."""


def _class(path: Path, what: str) -> Any:
    """The class for a file of this suffix; raises InputError, ExtraMissingError."""
    try:
        module, prefix = _KINDS[path.suffix]
    except KeyError:
        raise InputError("file", str(path), f"must end in {' or '.join(_KINDS)}") from None
    return getattr(load(module, extra="record"), prefix + what)
