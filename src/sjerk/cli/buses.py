"""The kernel of a TOML file together with the bus that its drives are on. Never here: motion."""

from __future__ import annotations

from sjerk.errors import InputError
from sjerk.kernel import MotionKernel, described, port_tables, read_table, without_ports
from sjerk.ports.ethercat.inside import port_of


def kernel_of(
    file: str, hardware: str = "", *, name: str | None = None, group: int | str | None = None
) -> MotionKernel:
    """The kernel of a file, its drives on the bus that it names, or simulated.

    ``hardware``: "simulated", whatever the file says; "ethercat"; or "", as it says. ``name``,
    ``group``: as of ``load``. Raises InputError, ConfigError, OSError.
    """
    table = read_table(file)
    wire = port_tables(table, "ethercat")
    if hardware == "simulated":
        return described(file, without_ports(table), name=name, group=group)
    if hardware == "ethercat" and wire is None:
        raise InputError("hardware", hardware, f"needs a table [ethercat] in {file}")
    kernel = described(file, table, name=name, group=group)
    if wire is not None:
        kernel.port = port_of(file, *wire)
    return kernel
