"""The electronic data sheet (CiA 306) of the drive: its object dictionary as text.

Never here: what an object means.
"""

from __future__ import annotations

from collections.abc import Mapping

from sjerk.drive.entries import ObjectEntry
from sjerk.drive.objects import DUMMIES, OBJECTS, PDOS, default


def eds(
    *,
    node_id: int = 1,
    file_name: str = "sjerk.eds",
    values: Mapping[tuple[int, int], int | float | str] | None = None,
) -> str:
    """The electronic data sheet of the drive (CiA 306), COB-IDs for the node `node_id`.

    `values` by index and sub-index take the place of defaults.

    >>> eds(node_id=5).splitlines()[0]
    '[FileInfo]'
    """
    values = values or {}
    mandatory = [0x1000, 0x1001, 0x1018]
    groups = {
        "MandatoryObjects": [i for i in OBJECTS if i in mandatory],
        "OptionalObjects": [i for i in OBJECTS if i not in mandatory and not 0x2000 <= i < 0x6000],
        "ManufacturerObjects": [i for i in OBJECTS if 0x2000 <= i < 0x6000],
    }
    lines = [
        "[FileInfo]",
        f"FileName={file_name}",
        "FileVersion=1",
        "FileRevision=0",
        "EDSVersion=4.0",
        "Description=Simulated servo drive, CiA 402",
        "CreatedBy=sjerk",
        "",
        "[DeviceInfo]",
        "VendorName=sjerk (no assigned vendor)",
        "VendorNumber=0",
        "ProductName=sjerk simulated drive",
        f"ProductNumber={OBJECTS[0x1018].entries[2].default:#x}",
        "RevisionNumber=1",
        *(f"BaudRate_{rate}=1" for rate in (10, 20, 50, 125, 250, 500, 800, 1000)),
        "SimpleBootUpMaster=0",
        "SimpleBootUpSlave=1",
        "Granularity=8",
        "DynamicChannelsSupported=0",
        "GroupMessaging=0",
        f"NrOfRXPDO={PDOS}",
        f"NrOfTXPDO={PDOS}",
        "LSS_Supported=0",
        "",
        "[DummyUsage]",
        *(f"Dummy{index:04X}=1" for index in DUMMIES),
        "",
    ]
    for group, indices in groups.items():
        lines += [f"[{group}]", f"SupportedObjects={len(indices)}"]
        lines += [f"{n}={index:#06x}" for n, index in enumerate(indices, 1)]
        lines.append("")
    for thing in OBJECTS.values():
        if thing.code == 7:
            lines += _section(f"{thing.index:04X}", thing.entries[0], node_id, values)
            continue
        lines += [
            f"[{thing.index:04X}]",
            f"ParameterName={thing.name}",
            f"ObjectType={thing.code:#x}",
            f"SubNumber={len(thing.entries)}",
            "",
        ]
        for row in thing.entries:
            lines += _section(f"{thing.index:04X}sub{row.sub:X}", row, node_id, values)
    return "\n".join(lines)


def _section(
    name: str, row: ObjectEntry, node_id: int, values: Mapping[tuple[int, int], int | float | str]
) -> list[str]:
    access = {"ro": "ro", "rw": "rw", "idle": "rw"}[row.access]
    if row.access != "ro" and row.pdo:
        access = {"R": "rww", "T": "rwr"}.get(row.pdo, "rw")
    value = values.get((row.index, row.sub), default(row, node_id))
    return [
        f"[{name}]",
        f"ParameterName={row.name}",
        "ObjectType=0x7",
        f"DataType={row.type.code:#06x}",
        f"AccessType={access}",
        f"DefaultValue={value if not isinstance(value, int) or value < 0 else hex(value)}",
        f"PDOMapping={int(bool(row.pdo))}",
        "",
    ]
