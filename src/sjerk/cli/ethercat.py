"""``sjerk ethercat``: what is on a cable, its description for a kernel, and its objects.

Whoever is on the cable commands the drives: EtherCAT has no authentication.

Never here: frames, what a device is set up with.
"""

from __future__ import annotations

import argparse
from typing import Any

from sjerk.cli.common import show
from sjerk.drive.entries import SdoError, Type
from sjerk.drive.objects import entry
from sjerk.errors import InputError
from sjerk.ports.ethercat.requests import Requests
from sjerk.ports.ethercat.settings import TYPES, object_of, pack_value


def add_arguments(jobs: Any) -> None:
    """Add ethercat."""
    parser = jobs.add_parser("ethercat", help="what is on an EtherCAT cable, and its objects")
    verbs = parser.add_subparsers(dest="verb", required=True)
    for verb, run, text in (
        ("scan", scan, "the devices on the cable"),
        ("describe", describe, "the TOML of a kernel for what is there, to be filled in"),
        ("read", read, "an object of a device, also beside a running kernel"),
        ("write", write, "write an object of a device, also beside a running kernel"),
    ):
        job = verbs.add_parser(verb, help=text)
        job.add_argument("interface")
        if verb in ("read", "write"):
            job.add_argument("position", type=int, help="on the cable, from 0")
            job.add_argument("object", help='as "6065" or "6099:1"')
        if verb == "write":
            job.add_argument("value", help="a number, or a text")
        if verb in ("read", "write"):
            job.add_argument("--type", choices=sorted(TYPES), help="of objects not known here")
        if verb != "describe":
            job.add_argument("--json", action="store_true", help="one JSON object per line")
        job.set_defaults(run=run)


def scan(options: argparse.Namespace) -> int:
    """One row per device."""
    with Requests(options.interface) as requests:
        show(options, {"devices": requests.scan()})
    return 0


def describe(options: argparse.Namespace) -> int:
    """Print the file."""
    with Requests(options.interface) as requests:
        print(requests.describe(), end="")
    return 0


def read(options: argparse.Namespace) -> int:
    """Print the value, and its bytes."""
    index, sub = object_of(options.object)
    with Requests(options.interface) as requests:
        data = requests.read(options.position, index, sub)
    kind = _type(options, index, sub)
    known = kind is not None and (not kind.size or kind.size == len(data))
    value = kind.unpack(data) if kind is not None and known else data.hex(" ")
    show(options, {"object": f"{index:04X}h:{sub}", "value": value, "bytes": data.hex(" ")})
    return 0


def write(options: argparse.Namespace) -> int:
    """Write, and print what is there then."""
    index, sub = object_of(options.object)
    kind = _type(options, index, sub)
    if kind is None:
        raise InputError("--type", None, f"is needed for {index:04X}h: {', '.join(TYPES)}")
    name = next(name for name, one in TYPES.items() if one is kind)
    data = pack_value(name, _number(kind, options.value))
    with Requests(options.interface) as requests:
        requests.write(options.position, index, sub, data)
    show(options, {"object": f"{index:04X}h:{sub}", "written": options.value})
    return 0


def _type(options: argparse.Namespace, index: int, sub: int) -> Type | None:
    if options.type is not None:
        return TYPES[options.type]
    try:
        return entry(index, sub).type
    except SdoError:
        return None


def _number(kind: Type, text: str) -> int | float | str:
    if kind is Type.VISIBLE_STRING:
        return text
    try:
        return float(text) if kind.limits is None else int(text, 0)
    except ValueError:
        raise InputError("value", text, "must be a number") from None
