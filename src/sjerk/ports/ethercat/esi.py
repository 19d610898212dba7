"""The ESI file (ETG.2000) of an emulated drive with its whole dictionary.

It is made from the tables that the SII and the CoE server are made from, so the three agree. The
vendor id is nobody's: the file describes a simulation.

Never here: the SII's bytes, values that change.
"""

from __future__ import annotations

from collections import Counter
from xml.etree import ElementTree as Xml

from sjerk.drive.entries import Object, ObjectEntry, Type
from sjerk.ports.ethercat.behaviours import Behaviour, Words
from sjerk.ports.ethercat.dictionary import REVISION, VENDOR, Dictionary
from sjerk.ports.ethercat.sii import SIZE, areas

_NAMES = {
    Type.INTEGER8: "SINT",
    Type.INTEGER16: "INT",
    Type.INTEGER32: "DINT",
    Type.UNSIGNED8: "USINT",
    Type.UNSIGNED16: "UINT",
    Type.UNSIGNED32: "UDINT",
    Type.REAL32: "REAL",
}
_KINDS = ("MBoxOut", "MBoxIn", "Outputs", "Inputs")


def esi(dictionary: Dictionary, behaviour: Behaviour, memory: bytes) -> str:
    """The file as text; `memory` is the SII, whose configuration it repeats."""
    root = Xml.Element("EtherCATInfo", Version="1.6")
    vendor = _add(root, "Vendor")
    _add(vendor, "Id", _hex(VENDOR))
    _add(vendor, "Name", "sjerk (not an assigned vendor id, simulation only)")
    descriptions = _add(root, "Descriptions")
    group = _add(_add(descriptions, "Groups"), "Group")
    _add(group, "Type", "Drives")
    _add(group, "Name", "Simulated drives", LcId="1033")
    device = _add(_add(descriptions, "Devices"), "Device", Physics="YY")
    _add(
        device,
        "Type",
        behaviour.name,
        ProductCode=_hex(behaviour.product),
        RevisionNo=_hex(REVISION),
    )
    _add(device, "Name", behaviour.name, LcId="1033")
    _info(_add(device, "Info"))
    _add(device, "GroupType", "Drives")
    profile = _add(device, "Profile")
    _add(profile, "ProfileNo", "402")
    _dictionary(_add(profile, "Dictionary"), dictionary)
    for kind in ("Outputs", "Inputs", "MBoxState"):
        _add(device, "Fmmu", kind)
    for area, kind in zip(areas(dictionary, behaviour), _KINDS, strict=True):
        size = {"DefaultSize": str(area.length)}
        if area.kind <= 2:
            size = {"MinSize": str(area.length), "MaxSize": str(area.length), **size}
        place = {"StartAddress": _hex(area.start), "ControlByte": _hex(area.control)}
        _add(device, "Sm", kind, **size, **place, Enable="1")
    for receive in (True, False):
        _pdos(device, dictionary, behaviour, receive=receive)
    coe = _add(_add(device, "Mailbox"), "CoE")
    coe.attrib.update(
        SdoInfo="1",
        PdoAssign="1",
        PdoConfig=str(int(behaviour.mapping_writable)),
        CompleteAccess=str(int(behaviour.complete_access)),
        SegmentedSdo="1",
    )
    _clocks(_add(device, "Dc"), behaviour)
    eeprom = _add(device, "Eeprom")
    _add(eeprom, "ByteSize", str(SIZE))
    _add(eeprom, "ConfigData", memory[:14].hex())
    Xml.indent(root, " ")
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"
    )


def _add(parent: Xml.Element, tag: str, text: str = "", **attributes: str) -> Xml.Element:
    child = Xml.SubElement(parent, tag, attributes)
    if text:
        child.text = text
    return child


def _hex(value: int) -> str:
    return f"#x{value:X}"


def _info(info: Xml.Element) -> None:
    timeout = _add(_add(info, "StateMachine"), "Timeout")
    for name, ms in (
        ("PreopTimeout", 3000),
        ("SafeopOpTimeout", 10000),
        ("BackToInitTimeout", 5000),
        ("BackToSafeopTimeout", 200),
    ):
        _add(timeout, name, str(ms))
    mailbox = _add(_add(info, "Mailbox"), "Timeout")
    _add(mailbox, "RequestTimeout", "100")
    _add(mailbox, "ResponseTimeout", "2000")


def _type_of(dictionary: Dictionary, row: ObjectEntry) -> tuple[str, int]:
    """Name of the data type and its bits."""
    if row.type is Type.VISIBLE_STRING:
        length = len(dictionary.upload(row.index, row.sub))
        return f"STRING({length})", 8 * length
    return _NAMES[row.type], row.bits


def _flags(parent: Xml.Element, row: ObjectEntry) -> None:
    flags = _add(parent, "Flags")
    access = _add(flags, "Access", "ro" if row.access == "ro" else "rw")
    if row.access in ("preop", "idle"):
        access.set("WriteRestrictions", "PreOP" if row.access == "preop" else "PreOP_SafeOP")
    if row.pdo:
        _add(flags, "PdoMapping", {"R": "R", "T": "T"}.get(row.pdo, "RT"))


def _dictionary(parent: Xml.Element, dictionary: Dictionary) -> None:
    types: dict[str, Xml.Element] = {}
    kinds, objects = _add(parent, "DataTypes"), _add(parent, "Objects")
    for thing in dictionary.objects.values():
        for row in thing.entries:
            name, bits = _type_of(dictionary, row)
            if name not in types:
                types[name] = _add(kinds, "DataType")
                _add(types[name], "Name", name)
                _add(types[name], "BitSize", str(bits))
    for thing in dictionary.objects.values():
        first = thing.entries[0]
        name, bits = _type_of(dictionary, first)
        if len(thing.entries) > 1:
            name = f"DT{thing.index:04X}"
            bits = _record(_add(kinds, "DataType"), name, thing, dictionary)
        item = _add(objects, "Object")
        _add(item, "Index", _hex(thing.index))
        _add(item, "Name", thing.name)
        _add(item, "Type", name)
        _add(item, "BitSize", str(bits))
        _flags(item, first)


def _record(parent: Xml.Element, name: str, thing: Object, dictionary: Dictionary) -> int:
    """A type of several entries; returns its bits. Names are keys: repeated ones get numbers."""
    often = Counter(row.name for row in thing.entries)
    _add(parent, "Name", name)
    size = _add(parent, "BitSize")
    at = 0
    for row in thing.entries:
        kind, bits = _type_of(dictionary, row)
        item = _add(parent, "SubItem")
        _add(item, "SubIdx", str(row.sub))
        _add(item, "Name", f"{row.name} {row.sub}" if often[row.name] > 1 else row.name)
        _add(item, "Type", kind)
        _add(item, "BitSize", str(bits))
        _add(item, "BitOffs", str(at))
        _flags(item, row)
        at += 16 if row.sub == 0 else bits
    size.text = str(at)
    return at


def _pdos(
    device: Xml.Element, dictionary: Dictionary, behaviour: Behaviour, *, receive: bool
) -> None:
    pdos = behaviour.rx_pdos if receive else behaviour.tx_pdos
    assigned = behaviour.rx_assigned if receive else behaviour.tx_assigned
    for index, words in pdos.items():
        pdo = _add(device, "RxPdo" if receive else "TxPdo")
        if index in assigned:
            pdo.set("Sm", "2" if receive else "3")
        if not behaviour.mapping_writable:
            pdo.set("Fixed", "1")
        _add(pdo, "Index", _hex(index))
        _add(pdo, "Name", f"PDO {index:04X}")
        if len(assigned) == 1:
            for other in pdos:
                if other != index:
                    _add(pdo, "Exclude", _hex(other))
        _entries(pdo, words, dictionary)


def _entries(pdo: Xml.Element, words: Words, dictionary: Dictionary) -> None:
    for word in words:
        entry = _add(pdo, "Entry")
        _add(entry, "Index", _hex(word >> 16))
        if word >> 16:
            row = dictionary.row(word >> 16, word >> 8 & 0xFF)
            _add(entry, "SubIndex", str(row.sub))
        _add(entry, "BitLen", str(word & 0xFF))
        if word >> 16:
            _add(entry, "Name", dictionary.objects[row.index].name)
            _add(entry, "DataType", _NAMES[row.type])


def _clocks(parent: Xml.Element, behaviour: Behaviour) -> None:
    modes = [("DC", "by the distributed clock", behaviour.assign_activate)]
    if not behaviour.dc_required:
        modes.append(("SM", "by the outputs", 0))
    for name, text, activate in modes:
        mode = _add(parent, "OpMode")
        _add(mode, "Name", name)
        _add(mode, "Desc", text)
        _add(mode, "AssignActivate", _hex(activate))
        if not activate:
            continue
        fixed = behaviour.sync0_ns
        _add(mode, "CycleTimeSync0", str(fixed), Factor="0" if fixed else "1")
        _add(mode, "ShiftTimeSync0", "0")
        if behaviour.by_sync1:
            _add(mode, "CycleTimeSync1", "0", Factor="1")
