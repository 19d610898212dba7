"""The only importer of the C extension: ``ffi`` and ``lib`` of ``sjerk._core``."""

from __future__ import annotations

from sjerk._core import ffi, lib

__all__ = ["ffi", "lib"]
