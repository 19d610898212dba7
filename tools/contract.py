"""The contract that cffi reads: the headers of the rooms, joined from the ground up.

    python tools/contract.py                 print the files that the contract is made of
    python tools/contract.py CDEF SOURCE     write what cffi reads, and the C that it compiles

A header of the contract has only structs, enums, prototypes and plain ``#define NAME number``; what
stands below the line ``/* For C only. */`` is left out. CMake and the sanitizer tests call this.
"""

from __future__ import annotations

import re
import sys
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
    "trajectory/_qp.h",
    "trajectory/_horizon.h",
    "trajectory/_arrow.h",
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
C_ONLY = "/* For C only. */"


def definitions() -> str:
    """All headers without their preprocessor lines for files, as cffi reads them."""
    parts = []
    for name in HEADERS:
        text = (SOURCES / name).read_text().partition(C_ONLY)[0]
        parts.append(re.sub(r"^#(pragma once|include .*)\n", "", text, flags=re.MULTILINE))
    return "\n".join(parts)


def source() -> str:
    """The C that the extension's generated code begins with."""
    return "#include <stddef.h>\n" + "".join(f'#include "{name}"\n' for name in HEADERS)


def main() -> int:
    """Print the headers, or write both files."""
    if len(sys.argv) == 1:
        print(*(SOURCES / name for name in HEADERS), sep="\n")
        return 0
    Path(sys.argv[1]).write_text(definitions())
    Path(sys.argv[2]).write_text(source())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
