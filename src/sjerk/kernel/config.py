"""A kernel from a TOML file or a table: axes, drives, clock, reactions; faults with their place.

Never here: what a table has (``tables.py``), motion, processes.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from sjerk.errors import ConfigError
from sjerk.kernel.kernel import MotionKernel
from sjerk.kernel.tables import kernel_fields


def load(
    path: Path | str, *, name: str | None = None, group: int | str | None = None
) -> MotionKernel:
    """Read a kernel from a TOML file; ``name`` of the segment, else the file's, else the file stem.

    ``group``: as of ``MotionKernel``.

    Raises ConfigError with the file and the place in it, OSError.

    A file: ``cycle_time`` (s), ``name``, tables ``[clock]`` (``Clock``) and ``[reactions]``
    (``Reactions``), and for each axis ``[[axes]]`` with the fields of ``Axis``: ``limits`` and
    ``stop_limits`` are tables of ``Limits``, ``drive`` a table of ``DriveConfig``, "ideal" or
    "external". Tables of ports ([ethercat], [axes.ethercat]) are left to ``sjerk kernel``, that of
    the panel ([panel]) to ``sjerk panel``.

    >>> load("/dev/null")
    Traceback (most recent call last):
    sjerk.errors.ConfigError: /dev/null: axes: needs at least one [[axes]]
    """
    return described(path, read_table(path), name=name, group=group)


def read_table(path: Path | str) -> dict[str, object]:
    """The tables of a TOML file; raises ConfigError, OSError."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as fault:  # also of text that is not UTF-8, of long numbers
        raise ConfigError(str(path), "syntax", None, str(fault)) from fault


def described(
    path: Path | str, table: object, *, name: str | None = None, group: int | str | None = None
) -> MotionKernel:
    """The kernel that a table describes, laid out as in ``load``; ``path`` is where it is from.

    Raises ConfigError.
    """
    top, values = kernel_fields(path, table)
    values["name"] = values.get("name", Path(path).stem) if name is None else name
    values["group"] = group
    kernel: MotionKernel = top.make(MotionKernel, (), values)
    return kernel
