"""The golden programs compute on this machine what they computed on others, bit for bit."""

from __future__ import annotations

import importlib.util
import json
from types import ModuleType

import numpy as np
import pytest

from helpers.root import ROOT


def golden() -> ModuleType:
    """The program, as a module."""
    spec = importlib.util.spec_from_file_location("golden", ROOT / "tools" / "golden.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


GOLDEN = golden()


@pytest.mark.parametrize("name", GOLDEN.PROGRAMS)
def test_a_golden_program_has_its_hash(name: str) -> None:
    """As recorded; docs/explanation/same_bits.md tells when and how to renew it."""
    recorded = json.loads(GOLDEN.RECORDED.read_text())
    assert set(recorded) == set(GOLDEN.PROGRAMS)
    assert GOLDEN.hashed(GOLDEN.PROGRAMS[name]) == recorded[name]


def test_the_golden_programs_move() -> None:
    """What is hashed is no constant: drives arrive, random numbers fill their range."""
    *_, last, ends = GOLDEN.ethercat()
    assert np.reshape(last, (2, 3))[:, 0].tolist() == [-1.5, 0.25]
    assert np.allclose(np.array(ends) / 2**24, [-1.5, 0.25], atol=1e-3)
    position = next(GOLDEN.kernel())
    assert np.ptp(position, axis=0).min() > 50.0
    drawn = GOLDEN.uniform(1, -1.0, 1.0, 10_000)
    assert np.histogram(drawn, 10, (-1.0, 1.0))[0].min() > 800


def test_one_bit_of_one_value_changes_a_hash() -> None:
    """Also the sign of a zero."""

    def program(value: float) -> str:
        made: str = GOLDEN.hashed(lambda: iter([[1.0, value]]))
        return made

    values = [2.0, float(np.nextafter(2.0, 3.0)), 0.0, -0.0]
    assert len({program(value) for value in values}) == 4
