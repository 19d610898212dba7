"""Run pytest against a build of the C core with sanitizers; a program, started by its test.

    python -m helpers.sanitized FOLDER [pytest arguments]

FOLDER gets a package ``sjerk`` of links to the Python sources and a `_core` built with ASan and
UBSan, which then shadows the installed one. Needs LD_PRELOAD of libasan; see test_sanitizers.py.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

from helpers.root import ROOT, SOURCES

FLAGS = [
    "-std=c11", "-g", "-O1", "-ffp-contract=off", "-fPIC", "-shared", "-fno-omit-frame-pointer",
    "-fsanitize=address,undefined", "-fno-sanitize-recover=all",
]  # fmt: skip


def build(folder: Path, flags: Sequence[str] = FLAGS, *, portable: bool = False) -> None:
    """Make the package in ``folder``; ``portable``: without the rooms that need Linux."""
    package = folder / "sjerk"
    package.mkdir()
    for source in SOURCES.iterdir():
        if source.suffix == ".py" or source.is_dir():
            (package / source.name).symlink_to(source)
    binding, cdef, begin = folder / "_core.c", folder / "_core.cdef", folder / "_core.c.in"
    contract = ROOT / "tools" / "contract.py"
    words = ["--portable"] if portable else []
    subprocess.run([sys.executable, contract, cdef, begin, *words], check=True)
    sources = [
        path for path in sorted(SOURCES.rglob("_*.c"))
        if not (portable and path.relative_to(SOURCES).parts[0] in ("kernel", "ports"))
    ]  # fmt: skip
    subprocess.run(
        [sys.executable, "-m", "cffi.gen_src", "read-sources", "sjerk._core", cdef, begin, binding],
        check=True,
    )
    subprocess.run(
        [os.environ.get("CC", "cc"), *flags, f"-I{SOURCES}", f"-I{sysconfig.get_path('include')}",
         binding, *sources, "-lm", "-o", package / "_core.abi3.so"],
        check=True,
    )  # fmt: skip


def library(name: str) -> str | None:
    """Where the compiler has a library of the sanitizers, to be preloaded; None: it has none."""
    found = subprocess.run(
        [os.environ.get("CC", "cc"), f"-print-file-name={name}"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    return found if os.path.isabs(found) else None


def main() -> int:
    """Test the package in the given folder."""
    folder = Path(sys.argv[1])
    # an editable installation answers imports before the path does
    sys.meta_path[:] = [f for f in sys.meta_path if "editable" not in type(f).__module__]
    sys.path.insert(0, str(folder))
    import pytest

    import sjerk._core

    assert Path(sjerk._core.__file__).parent.parent == folder
    return int(pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[2:]]))


if __name__ == "__main__":
    raise SystemExit(main())
