"""Recordings as MCAP files, by mcap (extra ``record``).

One message per cycle, event, command and record, in CDR with a ROS 2 message definition, so that
common viewers show them. Doubles keep every bit. What was written before a death can be read. Never
here: what a column means.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from sjerk.errors import InputError
from sjerk.recording.tables import FRAMES, Tables

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


class McapWriter:
    """A ``TableWriter``: one message per row, in the order of the cycles."""

    def __init__(self, path: Path, description: str) -> None:
        self._stream = path.open("wb")
        self._file: Any = Writer(
            self._stream, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._file.start(profile="", library="sjerk")
        self._file.add_metadata("sjerk", {"description": description})
        try:
            self._stream.flush()  # a disk that is full fails now
        except OSError:
            with contextlib.suppress(OSError):
                self._stream.close()
            raise
        self._channels: dict[str, tuple[int, np.dtype[Any]]] = {}

    def write(self, tables: Tables) -> None:
        """Append the messages of some cycles; the frame is the last of each."""
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
        self._stream.flush()

    def close(self) -> None:
        """End the file: its last chunk, its summary."""
        try:
            self._file.finish()
        finally:
            self._stream.close()


class _Whole:
    """A file that ends where it cannot give all that is asked for; how much is asked for nothing.

    ``mcap`` takes what is left for the whole, and lengths in a damaged file can be anything.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._left = os.fstat(file.fileno()).st_size

    def read(self, size: int) -> bytes:
        """So many bytes; raises EndOfFile where there are fewer."""
        if size > self._left:
            raise EndOfFile
        self._left -= size
        return self._file.read(size)


class McapReader:
    """A ``TableReader``, also of a file that was cut; raises InputError for what is none."""

    def __init__(self, path: Path) -> None:
        self._path = path
        description = None
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise InputError("file", str(path), "is no MCAP file")
        for record in self._records():
            if isinstance(record, Metadata) and record.name == "sjerk":
                description = record.metadata["description"]
                break
        if description is None:
            raise InputError("file", str(path), "is no recording of sjerk")
        self.description = description

    def _records(self) -> Iterator[Any]:
        """Every record, also of a file without an end; what is checked by checksums is."""
        with self._path.open("rb") as file:
            whole: Any = _Whole(file)
            try:
                yield from StreamReader(whole, validate_crcs=True).records
            except EndOfFile:
                file.seek(-len(_MAGIC), os.SEEK_END)
                if file.read() == _MAGIC:
                    why = "is damaged: a length in it leads beyond its end"
                    raise InputError("file", str(self._path), why) from None
                return  # its writer died, or it was cut; what came before is whole

    def tables(self) -> Iterator[Tables]:
        """Whole cycles only: what has no frame yet is left out."""
        schemas: dict[int, Any] = {}
        known: dict[int, tuple[str, np.dtype[Any]]] = {}
        rows: dict[str, list[bytes]] = {}
        begun: list[tuple[str, bytes]] = []  # of a cycle whose frame is still to come
        for record in self._records():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                text = schemas[record.schema_id].data.decode()
                known[record.id] = record.topic.rpartition("/")[2], _dtype(text)
            elif isinstance(record, Message):
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
