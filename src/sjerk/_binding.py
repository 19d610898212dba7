"""The only importer of the C extension, and the one place where a C struct becomes a numpy dtype.

``ffi`` and ``lib`` are those of ``sjerk._core``. Never here: what a struct means.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sjerk._core import ffi, lib

__all__ = ["dtype_of", "ffi", "lib"]


def dtype_of(kind: Any, *, last: int | None = None) -> np.dtype[Any]:
    """The structured dtype of a C struct, by its name or its ``ffi`` type, byte for byte.

    ``last``: how many elements the array at the end of the struct has, and of the structs within
    it; as declared by default.

    >>> dtype_of("sj_limits").names
    ('velocity', 'acceleration', 'jerk', 'deceleration', 'deceleration_jerk')
    """
    kind = ffi.typeof(kind) if isinstance(kind, str) else kind
    if kind.kind == "array":
        return np.dtype((dtype_of(kind.item), (kind.length if last is None else last,)))
    if kind.kind == "struct":
        members = kind.fields
        formats = [dtype_of(f.type, last=last if n == members[-1][0] else None) for n, f in members]
        size = ffi.sizeof(kind)
        if last is not None:
            size = members[-1][1].offset + formats[-1].itemsize
        return np.dtype(
            {
                "names": [n for n, _ in members],
                "formats": formats,
                "offsets": [f.offset for _, f in members],
                "itemsize": size,
            }
        )
    if kind.cname in ("double", "char"):
        return np.dtype("f8" if kind.cname == "double" else "S1")
    return np.dtype(f"{'u' if kind.cname.startswith('u') else 'i'}{ffi.sizeof(kind)}")
