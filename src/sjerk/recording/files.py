"""Recordings as files: Parquet (by pyarrow) or MCAP (by mcap), extra ``record``.

What goes in and comes out are columns, arrays whose first index is the row, and a text. Doubles
keep every bit. Parquet: one row per cycle, events and commands as lists in it; a file whose writer
died has no end and cannot be read. MCAP: one message per cycle, command and event, in CDR with a
ROS 2 message definition, so that common viewers show them; what was written before a death can be
read.
Never here: what a column means.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sjerk.errors import ConfigError, ExtraMissingError, InputError

#: Columns by table. "frames" has one row per cycle; all have a column ``cycle``.
Tables = dict[str, dict[str, NDArray[Any]]]

FRAMES = "frames"
_KEY = b"sjerk"


class Writer(Protocol):
    """Takes tables of consecutive cycles, in order."""

    def write(self, tables: Tables) -> None:
        """Append; every call has the same tables and columns."""

    def close(self) -> None:
        """End the file."""


def ready(path: Path) -> None:
    """Load what a file of this suffix needs; raises InputError, ExtraMissingError."""
    for name in _by_suffix(path, {".parquet": ("pyarrow.parquet",), ".mcap": ("mcap.writer",)}):
        _library(name)


def writer(path: Path, description: str) -> Writer:
    """A writer by the suffix of the file; raises InputError."""
    kinds: dict[str, Any] = {".parquet": _ParquetWriter, ".mcap": _McapWriter}
    made: Writer = _by_suffix(path, kinds)(path, description)
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


def reader(path: Path) -> Reader:
    """A reader by the suffix of the file; raises InputError, OSError.

    To be used within ``decoding``.
    """
    kinds: dict[str, Any] = {".parquet": _ParquetReader, ".mcap": _McapReader}
    if not path.exists():
        raise InputError("file", str(path), "does not exist")
    made: Reader = _by_suffix(path, kinds)(path)
    return made


class Reader(Protocol):
    """Gives the tables of a file back, in order, some thousand cycles at a time."""

    description: str

    def tables(self) -> Iterator[Tables]:
        """All of them, from the beginning."""


def _by_suffix(path: Path, kinds: Mapping[str, Any]) -> Any:
    try:
        return kinds[path.suffix]
    except KeyError:
        raise InputError("file", str(path), f"must end in {' or '.join(kinds)}") from None


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as fault:
        raise ExtraMissingError(name.partition(".")[0], "record") from fault


# ---- Parquet -------------------------------------------------------------------------------------


def _to_arrow(pa: Any, column: NDArray[Any]) -> Any:
    if column.dtype.kind == "V":
        size = column.dtype.itemsize
        data = pa.py_buffer(np.ascontiguousarray(column))
        return pa.Array.from_buffers(pa.binary(size), len(column), [None, data])
    if column.ndim == 2:
        flat = pa.array(np.ascontiguousarray(column).ravel())
        return pa.FixedSizeListArray.from_arrays(flat, column.shape[1])
    return pa.array(np.ascontiguousarray(column))


def _from_arrow(pa: Any, column: Any) -> NDArray[Any]:
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


class _ParquetWriter:
    def __init__(self, path: Path, description: str) -> None:
        self._pa, self._parquet = _library("pyarrow"), _library("pyarrow.parquet")
        self._path, self._description = path, description
        self._file: Any = None
        path.open("wb").close()  # a folder that cannot be written is told now

    def write(self, tables: Tables) -> None:
        pa = self._pa
        frames = tables[FRAMES]
        columns = {name: _to_arrow(pa, column) for name, column in frames.items()}
        for name, table in tables.items():
            if name == FRAMES:
                continue
            # the rows of a cycle as a list in the row of the cycle
            ends = np.searchsorted(table["cycle"], frames["cycle"], side="right")
            offsets = np.concatenate([[0], ends]).astype(np.int32)
            arrays = [_to_arrow(pa, column) for column in table.values()]
            rows = pa.StructArray.from_arrays(arrays, list(table))
            columns[name] = pa.ListArray.from_arrays(offsets, rows)
        arrow = pa.table(columns)
        if self._file is None:
            schema = arrow.schema.with_metadata({_KEY: self._description})
            # not for doubles: a dictionary takes -0.0 for 0.0
            whole = [n for n, c in frames.items() if c.dtype.kind in "iu"]
            self._file = self._parquet.ParquetWriter(
                self._path,
                schema,
                compression="zstd",
                compression_level=1,
                write_page_checksum=True,
                use_dictionary=[f"{n}.list.element" for n in whole] + whole,
            )
        self._file.write_table(arrow.cast(self._file.schema), row_group_size=len(frames["cycle"]))

    def close(self) -> None:
        if self._file is not None:
            self._file.close()


class _ParquetReader:
    def __init__(self, path: Path) -> None:
        self._pa, parquet = _library("pyarrow"), _library("pyarrow.parquet")
        try:
            self._file = parquet.ParquetFile(path, page_checksum_verification=True)
            self.description = self._file.schema_arrow.metadata[_KEY].decode()
        except self._pa.ArrowInvalid as fault:
            why = f"is no recording, or has no end: {_line(fault)}"
            raise InputError("file", str(path), why) from None
        except (KeyError, TypeError):
            why = "is no recording of sjerk: it has no metadata 'sjerk'"
            raise InputError("file", str(path), why) from None

    def tables(self) -> Iterator[Tables]:
        pa = self._pa
        for group in range(self._file.num_row_groups):
            arrow = self._file.read_row_group(group).combine_chunks()
            found: Tables = {FRAMES: {}}
            for name in arrow.column_names:
                column = arrow.column(name)
                column = column.chunk(0) if column.num_chunks else pa.array([], column.type)
                if pa.types.is_list(column.type):
                    rows = column.flatten()
                    found[name] = {
                        field.name: _from_arrow(pa, rows.field(i))
                        for i, field in enumerate(rows.type)
                    }
                else:
                    found[FRAMES][name] = _from_arrow(pa, column)
            yield found


# ---- MCAP ----------------------------------------------------------------------------------------

_ROS = {"f8": "float64", "S1": "uint8", "V": "uint8"}
_CDR = b"\x00\x01\x00\x00"  # plain CDR, little endian
_MAGIC = b"\x89MCAP0\r\n"
_ROWS = 4096


def _width(column: NDArray[Any]) -> int:
    """Elements of one row; 0: a plain one."""
    return column.dtype.itemsize if column.dtype.kind == "V" else (column.shape[1:] or (0,))[0]


def _ros(column: NDArray[Any]) -> str:
    kind = column.dtype
    if kind.kind in "iu":
        return f"{'u' if kind.kind == 'u' else ''}int{8 * kind.itemsize}"
    return _ROS["V" if kind.kind == "V" else kind.str[1:]]


def _sorted(table: Mapping[str, NDArray[Any]]) -> list[str]:
    """Columns with the widest elements first: then CDR needs no padding."""
    size = {n: 1 if c.dtype.kind == "V" else c.dtype.itemsize for n, c in table.items()}
    return sorted(table, key=lambda name: -size[name])


def _definition(table: Mapping[str, NDArray[Any]]) -> str:
    lines = []
    for name in _sorted(table):
        width = _width(table[name])
        lines.append(f"{_ros(table[name])}{f'[{width}]' if width else ''} {name}")
    return "\n".join(lines)


def _dtype(definition: str) -> np.dtype[Any]:
    """Of one message by its definition; its bytes are those of the message."""
    formats: list[Any] = [("cdr", "V4")]
    for line in definition.splitlines():
        kind, name = line.split(" ")
        kind, _, width = kind.partition("[")
        base = {"float64": "f8"}.get(kind) or f"{'u' if kind[0] == 'u' else 'i'}{_bits(kind) // 8}"
        formats.append((name, base, (int(width[:-1]),)) if width else (name, base))
    return np.dtype(formats)


def _bits(kind: str) -> int:
    return int("".join(c for c in kind if c.isdigit()))


class _McapWriter:
    def __init__(self, path: Path, description: str) -> None:
        module = _library("mcap.writer")
        self._stream = path.open("wb")
        self._file = module.Writer(
            self._stream, compression=module.CompressionType.ZSTD, enable_data_crcs=True
        )
        self._file.start(profile="", library="sjerk")
        self._file.add_metadata("sjerk", {"description": description})
        self._channels: dict[str, tuple[int, np.dtype[Any]]] = {}

    def write(self, tables: Tables) -> None:
        messages: list[tuple[int, bool, int, int, bytes]] = []
        for name, table in tables.items():
            if name not in self._channels:
                text = _definition(table)
                schema = self._file.register_schema(
                    name=f"sjerk/msg/{name.capitalize()}", encoding="ros2msg", data=text.encode()
                )
                channel = self._file.register_channel(
                    topic=f"/sjerk/{name}", message_encoding="cdr", schema_id=schema
                )
                self._channels[name] = channel, _dtype(text)
            channel, kind = self._channels[name]
            rows = np.empty(len(table["cycle"]), kind)
            rows["cdr"] = np.void(_CDR)
            for column, values in table.items():
                if values.dtype.kind == "V":
                    size = values.dtype.itemsize
                    values = np.ascontiguousarray(values).view(np.uint8).reshape(-1, size)
                rows[column] = values
            data, size = rows.tobytes(), kind.itemsize
            last = name == FRAMES  # a cycle ends with its frame
            messages += [
                (cycle, last, i, channel, data[i * size : (i + 1) * size])
                for i, cycle in enumerate(table["cycle"].tolist())
            ]
        frames = tables[FRAMES]
        times = dict(zip(frames["cycle"].tolist(), frames["time_ns"].tolist(), strict=True))
        for cycle, _, _, channel, message in sorted(messages, key=lambda m: m[:3]):
            time = times.get(cycle, 0)
            self._file.add_message(channel, log_time=time, data=message, publish_time=time)

    def close(self) -> None:
        self._file.finish()
        self._stream.close()


class _Whole:
    """A file that ends where it cannot give all that is asked for; how much is asked for nothing.

    ``mcap`` takes what is left for the whole, and lengths in a damaged file can be anything.
    """

    def __init__(self, file: IO[bytes], end: type[Exception]) -> None:
        self._file, self._end = file, end
        self._left = os.fstat(file.fileno()).st_size

    def read(self, size: int) -> bytes:
        """So many bytes; raises what stands for the end where there are fewer."""
        if size > self._left:
            raise self._end
        self._left -= size
        return self._file.read(size)


class _McapReader:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._stream, self._kinds = _library("mcap.stream_reader"), _library("mcap.records")
        self._faults = _library("mcap.exceptions")
        description = None
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise InputError("file", str(path), "is no MCAP file")
        for record in self._records():
            if isinstance(record, self._kinds.Metadata) and record.name == "sjerk":
                description = record.metadata["description"]
                break
        if description is None:
            raise InputError("file", str(path), "is no recording of sjerk")
        self.description = description

    def _records(self) -> Iterator[Any]:
        """Every record, also of a file without an end; what is checked by checksums is."""
        end = self._faults.EndOfFile
        with self._path.open("rb") as file:
            try:
                yield from self._stream.StreamReader(_Whole(file, end), validate_crcs=True).records
            except end:
                file.seek(-len(_MAGIC), os.SEEK_END)
                if file.read() == _MAGIC:
                    why = "is damaged: a length in it leads beyond its end"
                    raise InputError("file", str(self._path), why) from None
                return  # its writer died, or it was cut; what came before is whole

    def tables(self) -> Iterator[Tables]:
        schemas: dict[int, Any] = {}
        known: dict[int, tuple[str, np.dtype[Any]]] = {}
        rows: dict[str, list[bytes]] = {}
        begun: list[tuple[str, bytes]] = []  # of a cycle whose frame is still to come
        for record in self._records():
            if isinstance(record, self._kinds.Schema):
                schemas[record.id] = record
            elif isinstance(record, self._kinds.Channel):
                text = schemas[record.schema_id].data.decode()
                known[record.id] = record.topic.rpartition("/")[2], _dtype(text)
            elif isinstance(record, self._kinds.Message):
                name = known[record.channel_id][0]
                begun.append((name, record.data))
                if name != FRAMES:
                    continue
                for which, data in begun:
                    rows.setdefault(which, []).append(data)
                begun.clear()
                if len(rows[FRAMES]) >= _ROWS:
                    yield self._cut(rows, known)
        if rows.get(FRAMES):
            yield self._cut(rows, known)

    def _cut(
        self, rows: dict[str, list[bytes]], known: dict[int, tuple[str, np.dtype[Any]]]
    ) -> Tables:
        found: Tables = {}
        for name, kind in known.values():
            messages = rows.pop(name, [])
            table = np.frombuffer(b"".join(messages), kind)
            if len(table) != len(messages):
                raise InputError(name, len(table), f"must be {len(messages)} messages")
            found[name] = {column: table[column] for column in kind.names or () if column != "cdr"}
        return found
