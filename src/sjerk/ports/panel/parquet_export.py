"""Columns of signals as a Parquet file, by pyarrow (extra ``record``). Never here: signals."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet


def parquet_of(columns: Mapping[str, NDArray[Any]]) -> bytes:
    """The file's bytes: one row per cycle, numbers keep every bit."""
    made = io.BytesIO()
    # without a dictionary, which takes -0.0 for 0.0
    parquet.write_table(pa.table(dict(columns)), made, compression="zstd", use_dictionary=False)
    return made.getvalue()
