"""What a main device is told of its bus and its drives, checked; also from tables of a TOML file.

Never here: registers, frames, what a device says.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, fields
from typing import Any

from sjerk.drive.entries import SdoError, Type
from sjerk.drive.objects import entry
from sjerk.errors import ConfigError, InputError, SjerkError, real

TYPES = {
    "i8": Type.INTEGER8, "i16": Type.INTEGER16, "i32": Type.INTEGER32, "u8": Type.UNSIGNED8,
    "u16": Type.UNSIGNED16, "u32": Type.UNSIGNED32, "f32": Type.REAL32,
    "text": Type.VISIBLE_STRING,
}  # fmt: skip
"""Types of values by their names in files and on the command line."""
_OBJECT = re.compile(r"([0-9A-Fa-f]{4})h?(?::([0-9]{1,3}))?(?:/([0-9]{1,2}))?$")
_PADDING = re.compile(r"-([0-9]{1,2})$")


@dataclass(frozen=True)
class Word:
    """A mapped object; index 0: padding."""

    index: int
    sub: int
    bits: int

    @classmethod
    def of(cls, text: str) -> Word:
        """Read "607A", "60FE:1", "2010:1/16" (bits of an object that sjerk does not know), "-8".

        >>> Word.of("60FE:1")
        Word(index=24830, sub=1, bits=32)
        """
        if padding := _PADDING.match(text):
            return cls(0, 0, int(padding[1]))
        index, sub, bits = _object(text)
        if not bits:
            try:
                bits = 8 * entry(index, sub).type.size
            except SdoError:
                raise InputError("object", text, "needs its bits: 2010:1/16") from None
        return cls(index, sub, bits)

    @classmethod
    def unpack(cls, value: int) -> Word:
        """Of a mapping object: index << 16 | sub << 8 | bits."""
        return cls(value >> 16, value >> 8 & 0xFF, value & 0xFF)

    def pack(self) -> int:
        """As a mapping object has it."""
        return self.index << 16 | self.sub << 8 | self.bits


def _object(text: object) -> tuple[int, int, int]:
    found = _OBJECT.match(text) if isinstance(text, str) else None
    if found is None:
        raise InputError("object", text, 'must be as "6065" or "6099:1"')
    return int(found[1], 16), int(found[2] or 0), int(found[3] or 0)


def object_of(text: object) -> tuple[int, int]:
    """Index and sub-index of "6099:1"; raises `InputError`.

    >>> object_of("6099:1")
    (24729, 1)
    """
    index, sub, bits = _object(text)
    if bits or sub > 255:
        raise InputError("object", text, 'must be as "6065" or "6099:1"')
    return index, sub


@dataclass(frozen=True)
class Startup:
    """An object that is written in Pre-operational."""

    index: int
    sub: int
    data: bytes

    @classmethod
    def of(cls, row: Any) -> Startup:
        """Read ["6098:0", "i8", 37]."""
        if not isinstance(row, list | tuple) or len(row) != 3:
            raise InputError("startup", row, 'must be as ["6098:0", "i8", 37]')
        return cls(*object_of(row[0]), pack_value(row[1], row[2]))


def pack_value(kind: object, value: object) -> bytes:
    r"""A value of a type by its name; raises `InputError`.

    >>> pack_value("i16", -2)
    b'\xfe\xff'
    """
    if not isinstance(kind, str) or kind not in TYPES:
        raise InputError("type", kind, f"must be one of {', '.join(TYPES)}")
    wanted, limits = TYPES[kind], TYPES[kind].limits
    if wanted is Type.VISIBLE_STRING:
        if not isinstance(value, str) or not value.isascii():
            raise InputError("value", value, "must be a text in ASCII")
        return wanted.pack(value)
    if limits is None:
        return wanted.pack(real("value", value))
    if not isinstance(value, int) or isinstance(value, bool) or not limits[0] <= value <= limits[1]:
        raise InputError("value", value, f"must be a whole number {limits[0]} .. {limits[1]}")
    return wanted.pack(value)


def _numbers(field: str, value: Any, count: int | None, high: int) -> tuple[int, ...]:
    good = isinstance(value, list | tuple) and (count is None or len(value) == count)
    if not good or not all(type(x) is int and 0 <= x <= high for x in value):
        size = "" if count is None else f"{count} "
        raise InputError(field, value, f"must be {size}whole numbers 0 .. {high:#x}")
    return tuple(value)


@dataclass(frozen=True)
class DriveSettings:
    """One drive of the bus and how it is set up.

    ``position`` on the cable, from 0, or its ``alias``. ``identity``: vendor and product number;
    another device is refused. ``receive``, ``transmit``: what is mapped into ``rx_pdo``, ``tx_pdo``
    ("607A", "60FE:1", "2010:1/16", "-8" for 8 bits of padding); or ``rx_pdos``, ``tx_pdos``: PDOs
    that the drive has as they are; or neither: those that it has assigned. ``activate``:
    AssignActivate of its description, 0 without SYNC0. ``sync0_us``: of SYNC0 where SYNC1 makes the
    cycle (0700h), else 0. ``startup``: objects written before the mapping. Raises InputError.

    >>> DriveSettings(3, receive=("6040", "607A")).receive[1].bits
    32
    """

    position: int | None = None
    _: KW_ONLY
    alias: int | None = None
    identity: tuple[int, int] | None = None
    receive: tuple[Word, ...] = ()
    transmit: tuple[Word, ...] = ()
    rx_pdos: tuple[int, ...] = ()
    tx_pdos: tuple[int, ...] = ()
    rx_pdo: int = 0x1600
    tx_pdo: int = 0x1A00
    activate: int = 0x0300
    sync0_us: float = 0.0
    startup: tuple[Startup, ...] = ()

    def __post_init__(self) -> None:
        if (self.position is None) == (self.alias is None):
            raise InputError("position", self.position, "is needed, or an alias, not both")
        for name, high in (
            ("position", 0xFFFE), ("alias", 0xFFFF), ("rx_pdo", 0x17FF), ("tx_pdo", 0x1BFF),
            ("activate", 0xFFFF),
        ):  # fmt: skip
            value = getattr(self, name)
            if value is not None and (type(value) is not int or not 0 <= value <= high):
                raise InputError(name, value, f"must be a whole number 0 .. {high:#x}")
        if self.identity is not None:
            self._set("identity", _numbers("identity", self.identity, 2, 0xFFFFFFFF))
        for words, pdos in (("receive", "rx_pdos"), ("transmit", "tx_pdos")):
            self._set(pdos, _numbers(pdos, getattr(self, pdos), None, 0xFFFF))
            self._set(words, _words(words, getattr(self, words)))
            if getattr(self, words) and getattr(self, pdos):
                raise InputError(words, getattr(self, words), f"is for a free PDO, not for {pdos}")
        if not 0.0 <= real("sync0_us", self.sync0_us) <= 1e6:
            raise InputError("sync0_us", self.sync0_us, "must lie in 0 .. 1e6 us")
        if bool(self.activate & 0x0400) and not self.sync0_us:
            raise InputError("sync0_us", self.sync0_us, "is needed where SYNC1 makes the cycle")
        rows = self.startup if isinstance(self.startup, list | tuple) else (self.startup,)
        done = [row if isinstance(row, Startup) else Startup.of(row) for row in rows]
        self._set("startup", tuple(done))

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)


def _words(field: str, value: Any) -> tuple[Word, ...]:
    if not isinstance(value, list | tuple):
        raise InputError(field, value, "must be a list of objects")
    try:
        return tuple(word if isinstance(word, Word) else Word.of(word) for word in value)
    except InputError as fault:
        raise InputError(field, fault.value, fault.limit) from None


@dataclass(frozen=True, kw_only=True)
class BusSettings:
    """The bus.

    ``shift``: the frame is at the first clock this part of a cycle before SYNC0. ``lost``: cycles
    in a row without an answer after which a drive is lost. ``recover``: bring a device that fell
    out back to Operational; its axis stays in ErrorStop until a reset. ``others``: devices on the
    cable that no axis has, "refuse" or "ignore". Raises InputError.
    """

    shift: float = 0.5
    lost: int = 4
    recover: bool = True
    others: str = "refuse"

    def __post_init__(self) -> None:
        if not 0.0 < real("shift", self.shift) < 1.0:
            raise InputError("shift", self.shift, "must lie between 0 and 1")
        if type(self.lost) is not int or not 1 <= self.lost <= 1000:
            raise InputError("lost", self.lost, "must be a whole number 1 .. 1000")
        if type(self.recover) is not bool:
            raise InputError("recover", self.recover, "must be true or false")
        if self.others not in ("refuse", "ignore"):
            raise InputError("others", self.others, "must be refuse or ignore")


def from_tables(
    path: str, bus: object, axes: Mapping[int, object]
) -> tuple[str, BusSettings, dict[int, DriveSettings]]:
    """Interface, bus and drives by axis, of the tables [ethercat] and [axes.ethercat].

    Raises ConfigError with the place in the file.
    """
    table = dict(_table(path, "ethercat", bus))
    interface = table.pop("interface", None)
    if not isinstance(interface, str) or not interface:
        raise ConfigError(path, "ethercat.interface", interface, "must name a network interface")
    settings = _make(path, "ethercat", BusSettings, table)
    drives = {
        axis: _make(path, place, DriveSettings, _table(path, place, given))
        for axis, given in axes.items()
        for place in (f"axes[{axis}].ethercat",)
    }
    if not drives:
        raise ConfigError(path, "ethercat", None, "no axis has a table [axes.ethercat]")
    return interface, settings, drives


def _table(path: str, place: str, given: object) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise ConfigError(path, place, given, "must be a table")
    return given


def _make(path: str, place: str, kind: type[Any], table: Mapping[str, Any]) -> Any:
    known = [field.name for field in fields(kind)]
    for key, value in table.items():
        if key not in known:
            why = f"unknown; known are {', '.join(known)}"
            raise ConfigError(path, f"{place}.{key}", value, why)
    try:
        return kind(**table)
    except InputError as fault:
        raise ConfigError(path, f"{place}.{fault.field}", fault.value, fault.limit) from fault
    except SjerkError as fault:
        raise ConfigError(path, place, dict(table), str(fault)) from fault
