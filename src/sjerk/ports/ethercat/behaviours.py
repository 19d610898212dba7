"""Behaviours of real EtherCAT drives as data: which PDOs, which clocks, what is refused.

A main device that works with one drive often fails with the next: another PDO number, a fixed
mapping, SYNC0 wanted before Safe-operational. `BEHAVIOURS` holds such differences under neutral
names, so that a configuration can be tried before the drive arrives. No entry is a certain product.

Never here: code that acts on them, names or numbers of vendors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from sjerk.errors import InputError

Words = tuple[int, ...]
"""Mapping words: index << 16 | sub << 8 | bits; index 0 is padding."""

_SINGLE_RX: dict[int, Words] = {
    0x1601: (0x60400010, 0x607A0020),
    0x1602: (0x60400010, 0x60FF0020),
    0x1603: (0x60400010, 0x60710010),
}
_SINGLE_TX: dict[int, Words] = {
    0x1A01: (0x60410010, 0x60640020),
    0x1A02: (0x60410010, 0x606C0020),
    0x1A03: (0x60410010, 0x60770010),
}
_RX = (0x60400010, 0x60600008, 0x00000008, 0x607A0020, 0x60B10020, 0x60B20010)
_TX = (
    0x60410010, 0x60610008, 0x00000008, 0x60640020, 0x606C0020, 0x60770010, 0x603F0010, 0x60F40020,
    0x60FD0020,
)  # fmt: skip

AREA = 1024
"""Most bytes of process data in one direction."""


@dataclass(frozen=True, kw_only=True)
class Behaviour:
    """What an emulated drive offers and demands on EtherCAT; checked at construction.

    >>> Behaviour(mailbox=20)
    Traceback (most recent call last):
    sjerk.errors.InputError: mailbox = 20: must be 32 to 1024 bytes
    """

    name: str = "sjerk drive"
    """Object 1008h and the name in the SII."""
    product: int = 0x5E4B0402
    """Product code 1018h:2."""
    rx_pdos: Mapping[int, Words] = field(
        default_factory=lambda: MappingProxyType({0x1600: _RX, **_SINGLE_RX})
    )
    """PDOs that the main device can send: index to mapping words."""
    tx_pdos: Mapping[int, Words] = field(
        default_factory=lambda: MappingProxyType({0x1A00: _TX, **_SINGLE_TX})
    )
    """PDOs that the drive can send."""
    rx_assigned: tuple[int, ...] = (0x1600,)
    """1C12h after power-up."""
    tx_assigned: tuple[int, ...] = (0x1A00,)
    """1C13h after power-up."""
    mapping_writable: bool = True
    """The contents of the PDOs can be changed (in Pre-operational)."""
    entries: int = 32
    """Most objects of one PDO."""
    equal_write: bool = False
    """A mapping word that is there already may be written while sub-index 0 is not zero."""
    rx_bytes: int = AREA
    """Most bytes of outputs."""
    tx_bytes: int = AREA
    """Most bytes of inputs."""
    mailbox: int = 128
    """Bytes of each mailbox."""
    complete_access: bool = True
    """SDO complete access is offered."""
    sync_types: tuple[int, ...] = (0, 1, 2)
    """1C32h:1: 0 free run, 1 outputs, 2 SYNC0, 3 SYNC1."""
    sync_type: int = 1
    """1C32h:1 after power-up."""
    cycle_writable: bool = True
    """1C32h:2 can be written."""
    dc_required: int = 0
    """AL status code of the refusal of Safe-operational without SYNC0; 0: it is not needed."""
    deaf_without_dc: bool = False
    """Without SYNC0 on the way to Safe-operational the drive is enabled but never moves."""
    assign_activate: int = 0x0300
    """0981h:0980h, as the ESI file tells it; 0700h: SYNC1 begins the periods."""
    cycle_step_ns: int = 125_000
    """The period is a multiple of this."""
    cycle_least_ns: int = 125_000
    """The shortest period."""
    sync0_ns: int = 0
    """SYNC0 must have exactly this cycle; 0: it is the period."""
    clock_64: bool = True
    """System time has 64 bits, not 32."""

    def __post_init__(self) -> None:
        """Refuse what no subdevice controller could have; `InputError` names the field."""
        if not 32 <= self.mailbox <= 1024:
            raise InputError("mailbox", self.mailbox, "must be 32 to 1024 bytes")
        if not 1 <= self.entries <= 64:
            raise InputError("entries", self.entries, "must be 1 to 64 objects")
        for name in ("rx_bytes", "tx_bytes"):
            if not 0 <= getattr(self, name) <= AREA:
                raise InputError(name, getattr(self, name), f"must be 0 to {AREA} bytes")
        for name, pdos, assigned in (
            ("rx_assigned", self.rx_pdos, self.rx_assigned),
            ("tx_assigned", self.tx_pdos, self.tx_assigned),
        ):
            if missing := [index for index in assigned if index not in pdos]:
                raise InputError(name, f"{missing[0]:04X}h", "is no PDO of this drive")
        if self.sync_type not in self.sync_types:
            raise InputError("sync_type", self.sync_type, f"must be one of {self.sync_types}")

    @property
    def by_sync1(self) -> bool:
        """Whether SYNC1, not SYNC0, begins the periods."""
        return bool(self.assign_activate & 0x0400)


BEHAVIOURS: Mapping[str, Behaviour] = MappingProxyType(
    {
        "free": Behaviour(),
        "fixed": Behaviour(
            name="sjerk drive, fixed PDOs",
            product=0x5E4B0403,
            rx_pdos=MappingProxyType(
                {
                    0x1701: (0x60400010, 0x607A0020, 0x60FE0120),
                    0x1702: (0x60400010, 0x607A0020, 0x60FF0020, 0x60710010, 0x60600008, 0x8),
                    0x1600: (0x60400010, 0x607A0020),
                }
            ),
            tx_pdos=MappingProxyType(
                {
                    0x1B01: (0x603F0010, 0x60410010, 0x60640020, 0x60770010, 0x60F40020,
                             0x60FD0020),
                    0x1B02: (0x603F0010, 0x60410010, 0x60640020, 0x60770010, 0x60610008, 0x8,
                             0x60FD0020),
                    0x1A00: (0x60410010, 0x60640020),
                }
            ),
            rx_assigned=(0x1701,),
            tx_assigned=(0x1B01,),
            mapping_writable=False,
            rx_bytes=32,
            tx_bytes=38,
            sync_types=(2,),
            sync_type=2,
            cycle_writable=False,
            dc_required=0x28,
        ),
        "sync1": Behaviour(
            name="sjerk drive, SYNC1",
            product=0x5E4B0404,
            mailbox=512,
            sync_types=(1, 3),
            sync_type=1,
            assign_activate=0x0700,
            sync0_ns=62_500,
        ),
        "deaf": Behaviour(
            name="sjerk drive, deaf without SYNC0",
            product=0x5E4B0405,
            complete_access=False,
            sync_types=(0, 2),
            sync_type=0,
            deaf_without_dc=True,
            cycle_writable=False,
        ),
        "maps": Behaviour(
            name="sjerk drive, four maps",
            product=0x5E4B0406,
            rx_pdos=MappingProxyType(
                {
                    0x1600: (0x60400010, 0x60600008, 0x60710010, 0x607A0020, 0x60FF0020,
                             0x60B20010),
                    0x1601: (0x60FE0120, 0x60FE0220),
                    0x1602: (0x60B10020,),
                    0x1603: (),
                }
            ),
            tx_pdos=MappingProxyType(
                {
                    0x1A00: (0x60410010, 0x60610008, 0x60640020, 0x606C0020, 0x60770010),
                    0x1A01: (0x60F40020,),
                    0x1A02: (0x603F0010, 0x60FD0020),
                    0x1A03: (),
                }
            ),
            rx_assigned=(0x1600, 0x1601, 0x1602),
            tx_assigned=(0x1A00, 0x1A01, 0x1A02),
            entries=10,
            equal_write=True,
            mailbox=256,
            clock_64=False,
            cycle_least_ns=250_000,
            cycle_step_ns=250_000,
        ),
    }
)  # fmt: skip
"""By name.

`free`: free mapping. `fixed`: fixed PDOs, SYNC0 before Safe-operational. `sync1`: a SYNC0 of
62.5 us, SYNC1 as the cycle. `deaf`: does not move without SYNC0. `maps`: several small PDOs at
once, a 32-bit clock.
"""
