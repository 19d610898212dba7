"""Recordings as Parquet files, by pyarrow (extra ``record``).

One row per cycle; events, commands and records of the cycle are lists in it. Doubles keep every
bit. A file whose writer died has no end and cannot be read. Never here: what a column means.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from sjerk.errors import InputError
from sjerk.recording.tables import FRAMES, Tables

_KEY = b"sjerk"


def _to_arrow(column: NDArray[Any]) -> Any:
    if column.dtype.kind == "V":
        size = column.dtype.itemsize
        data = pa.py_buffer(np.ascontiguousarray(column))
        return pa.Array.from_buffers(pa.binary(size), len(column), [None, data])
    if column.ndim == 2:
        flat = pa.array(np.ascontiguousarray(column).ravel())
        return pa.FixedSizeListArray.from_arrays(flat, column.shape[1])
    return pa.array(np.ascontiguousarray(column))


def _from_arrow(column: Any) -> NDArray[Any]:
    if pa.types.is_fixed_size_list(column.type):
        width = column.type.list_size
        flat: NDArray[Any] = column.flatten().to_numpy(zero_copy_only=False)
        return flat.reshape(-1, width)
    if pa.types.is_fixed_size_binary(column.type):
        size = column.type.byte_width
        data = column.buffers()[1]
        begin = column.offset * size
        raw = np.frombuffer(data, np.uint8)[begin : begin + len(column) * size]
        return raw.copy().view(np.dtype((np.void, size)))
    found: NDArray[Any] = column.to_numpy(zero_copy_only=False)
    return found


class ParquetWriter:
    """A ``TableWriter``: one row group per call."""

    def __init__(self, path: Path, description: str) -> None:
        self._path, self._description = path, description
        self._file: Any = None
        path.write_bytes(b"PAR1")  # a folder that cannot be written, a disk that is full: fails now

    def write(self, tables: Tables) -> None:
        """Append a row group of some cycles."""
        frames = tables[FRAMES]
        columns = {name: _to_arrow(column) for name, column in frames.items()}
        for name, table in tables.items():
            if name == FRAMES:
                continue
            # the rows of a cycle as a list in the row of the cycle
            ends = np.searchsorted(table["cycle"], frames["cycle"], side="right")
            offsets = np.concatenate([[0], ends]).astype(np.int32)
            arrays = [_to_arrow(column) for column in table.values()]
            rows = pa.StructArray.from_arrays(arrays, list(table))
            columns[name] = pa.ListArray.from_arrays(offsets, rows)
        arrow = pa.table(columns)
        if self._file is None:
            schema = arrow.schema.with_metadata({_KEY: self._description})
            # not for doubles: a dictionary takes -0.0 for 0.0
            whole = [n for n, c in frames.items() if c.dtype.kind in "iu"]
            self._file = parquet.ParquetWriter(
                self._path,
                schema,
                compression="zstd",
                compression_level=1,
                write_page_checksum=True,
                use_dictionary=[f"{n}.list.element" for n in whole] + whole,
            )
        self._file.write_table(arrow.cast(self._file.schema), row_group_size=len(frames["cycle"]))

    def close(self) -> None:
        """End the file: without its end it cannot be read."""
        if self._file is not None:
            self._file.close()


class ParquetReader:
    """A ``TableReader``; raises InputError for what is no recording."""

    def __init__(self, path: Path) -> None:
        try:
            self._file = parquet.ParquetFile(path, page_checksum_verification=True)
            self.description = self._file.schema_arrow.metadata[_KEY].decode()
        except pa.ArrowInvalid as fault:
            first = str(fault).partition("\n")[0]
            why = f"is no recording, or has no end: {first}"
            raise InputError("file", str(path), why) from None
        except (KeyError, TypeError):
            why = "is no recording of sjerk: it has no metadata 'sjerk'"
            raise InputError("file", str(path), why) from None

    def tables(self) -> Iterator[Tables]:
        """One row group after the other."""
        for group in range(self._file.num_row_groups):
            arrow = self._file.read_row_group(group).combine_chunks()
            found: Tables = {FRAMES: {}}
            for name in arrow.column_names:
                column = arrow.column(name)
                column = column.chunk(0) if column.num_chunks else pa.array([], column.type)
                if pa.types.is_list(column.type):
                    rows = column.flatten()
                    found[name] = {
                        field.name: _from_arrow(rows.field(i)) for i, field in enumerate(rows.type)
                    }
                else:
                    found[FRAMES][name] = _from_arrow(column)
            yield found
