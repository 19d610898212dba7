"""Cycles of a trace as columns, and back: one column per number of a C struct.

Never here: files.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sjerk.errors import InputError
from sjerk.host import EventKind
from sjerk.kernel.trace import Chunk, event_dtype, frame_dtype, row_dtype

#: Columns by table, arrays whose first index is the row. All tables have a column ``cycle``.
Tables = dict[str, dict[str, NDArray[Any]]]

#: The table with one row per cycle.
FRAMES = "frames"


def _flat(kind: np.dtype[Any], prefix: str = "") -> Iterator[tuple[str, tuple[str, ...]]]:
    """Column name and path of every number of a struct."""
    for name in kind.names or ():
        inner = kind[name].base
        path = (name,)
        if name == "reserved" or (prefix == "head_" and name != "cycle"):
            continue
        if inner.names:
            below = "" if name in ("head", "axis") else f"{name.rstrip('s')}_"
            for column, rest in _flat(inner, "head_" if name == "head" else below):
                yield column, path + rest
        else:
            yield (name if prefix == "head_" else prefix + name), path


def _to_columns(rows: NDArray[Any]) -> dict[str, NDArray[Any]]:
    found = {}
    for column, path in _flat(rows.dtype):
        values = rows
        for name in path:
            values = values[name]
        found[column] = values
    return found


def _from_columns(columns: dict[str, NDArray[Any]], kind: np.dtype[Any], n: int) -> NDArray[Any]:
    rows = np.zeros(n, kind)
    for column, path in _flat(kind):
        into = rows
        for name in path:
            into = into[name]
        into[...] = _column(columns, column, into)
    return rows


def _column(columns: dict[str, NDArray[Any]], name: str, like: NDArray[Any]) -> NDArray[Any]:
    """A column that fits; raises InputError."""
    found = columns.get(name)
    if found is None:
        raise InputError("column", name, "is missing, or the file is of another version")
    if (found.dtype, found.shape) != (like.dtype, like.shape):
        have, want = (f"{array.dtype}{list(array.shape)}" for array in (found, like))
        raise InputError("column", name, f"must be {want}, is {have}")
    return found


def tables_of(chunk: Chunk) -> Tables:
    """The columns of some cycles."""
    frames = _to_columns(chunk.frames) | {"missed": chunk.missed}
    found = {FRAMES: frames, "events": _to_columns(chunk.events)}
    for name in ("commands", "records", "stops"):
        rows = getattr(chunk, name)
        found[name] = {part: rows[part] for part in rows.dtype.names}
    return found


def chunk_of(tables: Tables, axes: int) -> Chunk:
    """The cycles of some columns.

    Raises InputError for what was not written by ``tables_of`` for so many axes.
    """
    for name in (FRAMES, "events", "commands", "records"):
        if "cycle" not in tables.get(name, {}):
            raise InputError("column", f"{name}.cycle", "is missing")
    frames, event_columns = tables[FRAMES], tables["events"]
    n, k = len(frames["cycle"]), len(event_columns["cycle"])
    events = _from_columns(event_columns, event_dtype(), k) if k else np.empty(0, event_dtype())
    strange = set(events["kind"].tolist()) - set(EventKind)
    if strange:
        raise InputError("events.kind", min(strange), "is no kind of event")
    return Chunk(
        _from_columns(frames, frame_dtype(axes), n),
        _column(frames, "missed", np.empty(n, np.uint64)),
        _rows(tables["commands"], row_dtype(axes, "command")),
        _rows(tables["records"], row_dtype(axes, "record")),
        events,
        _stops(tables, events, row_dtype(axes, "stop")),
    )


def _stops(tables: Tables, events: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """None in a file from before there were stops beside the host: no event tells of one."""
    told = np.any(events["kind"] == EventKind.STOP)
    if "cycle" not in tables.get("stops", {}) and (told or "stops" in tables):
        raise InputError("column", "stops.cycle", "is missing")
    return _rows(tables["stops"], kind) if "stops" in tables else np.empty(0, kind)


def _rows(table: dict[str, NDArray[Any]], kind: np.dtype[Any]) -> NDArray[Any]:
    rows = np.empty(len(table["cycle"]), kind)
    for name in kind.names or () if len(rows) else ():
        if name not in table:
            raise InputError("column", name, "is missing")
        rows[name] = np.ascontiguousarray(table[name]).view(kind[name]).reshape(len(rows))
    return rows
