"""Cube root and exp(x) - 1 of the C core against exact arithmetic; no C calls those of libm."""

from __future__ import annotations

import ctypes
import math
import os
import re
import subprocess
import sys
from decimal import Decimal, localcontext
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from helpers.root import SOURCES

#: Libraries round these as they like.
INEXACT = (
    "acos|asin|atan|atan2|cbrt|cos|cosh|erf|exp|exp2|exp10|expm1|hypot|lgamma|log|log10|log1p|log2|pow"
    "|sin|sinh|tan|tanh|tgamma"
)
#: Units in the last place.
BOUND = Fraction(51, 100)


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The header, compiled as the extension is."""
    folder = tmp_path_factory.mktemp("math")
    source, library = folder / "math.c", folder / "math.so"
    source.write_text(
        '#include "base/_math.h"\n'
        "double root(double x) { return cube_root(x); }\n"
        "double less(double x) { return exp_minus_1(x); }\n"
    )
    flags = ["-std=c11", "-O3", "-ffp-contract=off", "-fPIC", "-shared", f"-I{SOURCES}"]
    order = [os.environ.get("CC", "cc"), *flags, str(source), "-o", str(library), "-lm"]
    subprocess.run(order, check=True)
    made = ctypes.CDLL(str(library))
    for function in (made.root, made.less):
        function.argtypes, function.restype = [ctypes.c_double], ctypes.c_double
    return made


def test_a_cube_root_is_within_half_a_unit(core: ctypes.CDLL) -> None:
    """In rationals: the true root lies between the ends of that interval, by their cubes."""

    @given(st.floats(allow_nan=False, allow_infinity=False))
    @example(8.0)
    @example(-27.0)
    @example(5e-324)
    @example(sys.float_info.max)
    @example(sys.float_info.min)
    def judge(x: float) -> None:
        t = core.root(x)
        near = BOUND * Fraction(math.ulp(t))
        if x == 0.0:
            assert (t, math.copysign(1.0, t)) == (x, math.copysign(1.0, x))
            return
        assert (Fraction(t) - near) ** 3 <= Fraction(x) <= (Fraction(t) + near) ** 3

    judge()
    assert core.root(math.inf) == math.inf
    assert core.root(-math.inf) == -math.inf
    assert math.isnan(core.root(math.nan))
    assert [core.root(float(n**3)) for n in range(-200, 200)] == [
        float(n) for n in range(-200, 200)
    ]


def test_exp_minus_1_is_within_half_a_unit(core: ctypes.CDLL) -> None:
    """In decimals of 400 digits, over everything that does not overflow."""

    @given(st.floats(-800.0, 709.7827128933839) | st.floats(-1.0, 1.0))
    @example(-40.0)
    @example(-39.99999999)
    @example(709.7827128933839)
    @example(0.03125)
    @example(5e-324)
    @example(-1e-16)
    @example(2.0**-54)
    def judge(x: float) -> None:
        y = core.less(x)
        with localcontext() as context:
            context.prec = 400
            truth = Decimal(x).exp() - 1
            assert abs(Decimal(y) - truth) <= Decimal(51) / 100 * Decimal(math.ulp(y))

    judge()
    assert core.less(-math.inf) == -1.0
    assert core.less(math.inf) == core.less(709.79) == math.inf
    assert math.isnan(core.less(math.nan))


@pytest.mark.parametrize("file", sorted(SOURCES.rglob("_*.[ch]")), ids=lambda path: path.name)
def test_no_c_calls_what_libraries_round_differently(file: Path) -> None:
    """Neither a double's function nor one of another width."""
    code = re.sub(r"/\*.*?\*/", "", file.read_text(), flags=re.DOTALL)
    assert not re.findall(rf"\b(?:{INEXACT})[fl]?\(", code)
