"""The benchmarks name only what the library has: they run by hand, and must not decay between."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from helpers.root import ROOT
from sjerk._core import ffi, lib

FILES = sorted((ROOT / "benchmarks").glob("*.py"))


def known(name: str) -> bool:
    """A function of the library, or a type."""
    if hasattr(lib, name):
        return True
    try:
        ffi.typeof(name)
    except ffi.error:
        return False
    return True


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_each_name_of_the_c_is_there(file: Path) -> None:
    """Also those that stand in strings."""
    names = set(re.findall(r"\bsj_[a-z0-9_]+\b", file.read_text()))
    assert [name for name in sorted(names) if not known(name)] == []


def test_a_name_that_is_not_there_is_found() -> None:
    """The check is seen to be able to fail."""
    assert known("sj_kernel_cycle")
    assert known("sj_kernel")
    assert not known("sj_kernel_cyclic")
