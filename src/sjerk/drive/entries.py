"""What an object dictionary is made of: data types, abort codes, objects and their entries.

Never here: which objects there are.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass

from sjerk.errors import SjerkError


class Type(enum.Enum):
    """Data types of CiA 301: (code, struct format)."""

    INTEGER8 = (0x02, "b")
    """A signed integer of one byte."""
    INTEGER16 = (0x03, "h")
    """A signed integer of two bytes."""
    INTEGER32 = (0x04, "i")
    """A signed integer of four bytes."""
    UNSIGNED8 = (0x05, "B")
    """An unsigned integer of one byte."""
    UNSIGNED16 = (0x06, "H")
    """An unsigned integer of two bytes."""
    UNSIGNED32 = (0x07, "I")
    """An unsigned integer of four bytes."""
    REAL32 = (0x08, "f")
    """A float of four bytes (IEEE 754)."""
    VISIBLE_STRING = (0x09, "")
    """Text in ASCII."""

    @property
    def code(self) -> int:
        """The number of the type in an electronic data sheet."""
        return self.value[0]

    @property
    def size(self) -> int:
        """Bytes of a value; 0 for text, which has as many as it has characters."""
        return struct.calcsize("<" + self.value[1]) if self.value[1] else 0

    @property
    def limits(self) -> tuple[int, int] | None:
        """Smallest and largest value of an integer type; None for the others.

        >>> Type.INTEGER8.limits
        (-128, 127)
        """
        if self in (Type.REAL32, Type.VISIBLE_STRING):
            return None
        bits = 8 * self.size
        if self.value[1].islower():
            return -(1 << (bits - 1)), (1 << (bits - 1)) - 1
        return 0, (1 << bits) - 1

    def pack(self, value: int | float | str) -> bytes:
        """The value as it goes over the wire, little-endian."""
        if isinstance(value, str):
            return value.encode("ascii")
        return struct.pack("<" + self.value[1], value)

    def unpack(self, data: bytes) -> int | float | str:
        """The value of bytes from the wire; their number must be right."""
        if self is Type.VISIBLE_STRING:
            return data.decode("ascii", "replace")
        value: int | float = struct.unpack("<" + self.value[1], data)[0]
        return value


class Abort(enum.IntEnum):
    """SDO abort codes of CiA 301."""

    TOGGLE = 0x05030000
    """The toggle bit did not alternate."""
    COMMAND = 0x05040001
    """The command is not valid or not known."""
    UNSUPPORTED_ACCESS = 0x06010000
    """The object does not support this access."""
    WRITE_ONLY = 0x06010001
    """The object can only be written."""
    READ_ONLY = 0x06010002
    """The object can only be read."""
    NO_OBJECT = 0x06020000
    """The dictionary has no such object."""
    NOT_MAPPABLE = 0x06040041
    """The object cannot be mapped into the PDO."""
    PDO_LENGTH = 0x06040042
    """The mapped objects are longer than a PDO."""
    LENGTH = 0x06070010
    """The length does not match the type."""
    TOO_LONG = 0x06070012
    """The data are longer than the type."""
    TOO_SHORT = 0x06070013
    """The data are shorter than the type."""
    NO_SUBINDEX = 0x06090011
    """The object has no such sub-index."""
    RANGE = 0x06090030
    """The value is outside its range."""
    TOO_HIGH = 0x06090031
    """The value is above its range."""
    TOO_LOW = 0x06090032
    """The value is below its range."""
    MAX_BELOW_MIN = 0x06090036
    """The maximum would be below the minimum."""
    CANNOT_STORE = 0x08000020
    """The data cannot be stored: the signature is wrong."""
    LOCAL_CONTROL = 0x08000021
    """The device is under local control."""
    DEVICE_STATE = 0x08000022
    """The present state of the device does not allow it."""


class SdoError(SjerkError):
    """An access that the dictionary refuses: `abort`, `index`, `sub`.

    >>> print(SdoError(Abort.READ_ONLY, 0x6041, 0))
    6041h:0: read_only (06010002h)
    """

    def __init__(self, abort: Abort, index: int, sub: int) -> None:
        """Name the object and the abort code."""
        super().__init__(f"{index:04X}h:{sub}: {abort.name.lower()} ({int(abort):08X}h)")
        self.abort, self.index, self.sub = abort, index, sub


@dataclass(frozen=True)
class ObjectEntry:
    """One object or sub-object: what an SDO or a PDO can reach.

    `access` is "ro", "rw", or "idle": writable while the drive is not enabled. `pdo` has "R" where
    it may be mapped into a receive PDO, "T" into a transmit PDO. `unit` is for people, `source`
    says where the value lives (`sjerk.drive.objects`).

    >>> ObjectEntry(0x607A, 0, "Target position", Type.INTEGER32, "rw").bits
    32
    """

    index: int
    sub: int
    name: str
    type: Type
    access: str
    pdo: str = ""
    default: int | float | str = 0
    unit: str = ""
    source: str = ""

    @property
    def bits(self) -> int:
        """Length in a PDO, bits."""
        return 8 * self.type.size


@dataclass(frozen=True)
class Object:
    """An object: one entry (variable) or entries from sub-index 0 on (array, record).

    `code` is its object code: 7 variable, 8 array, 9 record.
    """

    index: int
    name: str
    entries: tuple[ObjectEntry, ...]
    code: int


I8, I16, I32 = Type.INTEGER8, Type.INTEGER16, Type.INTEGER32
U8, U16, U32 = Type.UNSIGNED8, Type.UNSIGNED16, Type.UNSIGNED32
REAL, TEXT = Type.REAL32, Type.VISIBLE_STRING

Row = tuple[str, Type, str, str, int | float | str, str, str]


def var(
    index: int,
    name: str,
    type_: Type,
    access: str,
    pdo: str = "",
    default: int | float | str = 0,
    unit: str = "",
    source: str = "",
) -> Object:
    """An object of one entry."""
    entry = ObjectEntry(index, 0, name, type_, access, pdo, default, unit, source)
    return Object(index, name, (entry,), 7)


def many(index: int, name: str, *rows: Row, code: int = 8, count: str = "ro") -> Object:
    """An array or record; `count` is the access of sub-index 0."""
    head = ObjectEntry(index, 0, "Highest sub-index", U8, count, "", len(rows), "", "")
    subs = (ObjectEntry(index, sub, *row) for sub, row in enumerate(rows, 1))
    return Object(index, name, (head, *subs), code)
