"""The contract that cffi reads: the headers of the rooms, joined from the ground up.

    python tools/contract.py                 print the files that the contract is made of
    python tools/contract.py CDEF SOURCE     write what cffi reads, and the C that it compiles
    python tools/contract.py CDEF SOURCE --portable     the same without the rooms that need Linux

A header of the contract has only structs, enums, prototypes and plain ``#define NAME number``; what
stands below the line ``/* For C only. */`` is left out. CMake and the sanitizer tests call this.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path

SOURCES = Path(__file__).resolve().parent.parent / "src" / "sjerk"
#: From the ground up: each header needs only those before it.
HEADERS = (
    "base/_types.h",
    "base/_build.h",
    "planner/_planner.h",
    "dpram/_dpram.h",
    "drive/_words.h",
    "drive/_drive.h",
    "_kernel.h",
    "trajectory/_arrow.h",
    "trajectory/_horizon.h",
    "trajectory/_following.h",
    "trajectory/_track.h",
    "trajectory/_pace.h",
    "cycle/_states.h",
    "cycle/_payload.h",
    "cycle/_trace_items.h",
    "cycle/_state.h",
    "cycle/_cycle.h",
    "cycle/_exchange.h",
    "kernel/_clock.h",
    "ports/ethercat/_esc.h",
    "ports/ethercat/_frame.h",
    "ports/ethercat/_wire.h",
)
#: Rooms whose C speaks with Linux: the clock of the process, and sockets.
LINUX = ("kernel/", "ports/")
C_ONLY = "/* For C only. */"


def definitions(headers: Sequence[str]) -> str:
    """The headers without their preprocessor lines for files, as cffi reads them."""
    parts = []
    for name in headers:
        text = (SOURCES / name).read_text().partition(C_ONLY)[0]
        parts.append(re.sub(r"^#(pragma once|include .*)\n", "", text, flags=re.MULTILINE))
    return "\n".join(parts)


def source(headers: Sequence[str]) -> str:
    """The C that the extension's generated code begins with."""
    return "#include <stddef.h>\n" + "".join(f'#include "{name}"\n' for name in headers)


def main() -> int:
    """Print the headers, or write both files."""
    words = [word for word in sys.argv[1:] if word != "--portable"]
    headers = [name for name in HEADERS if words == sys.argv[1:] or not name.startswith(LINUX)]
    if not words:
        print(*(SOURCES / name for name in headers), sep="\n")
        return 0
    Path(words[0]).write_text(definitions(headers))
    Path(words[1]).write_text(source(headers))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
