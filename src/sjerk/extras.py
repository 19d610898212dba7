"""Optional extras: how a module of sjerk that needs one is imported.

Such a module imports its extra at its top, as any other; only who needs it loads it, so that sjerk
itself runs without. Never here: which module needs which extra.
"""

from __future__ import annotations

import importlib
from types import ModuleType

from sjerk.errors import ExtraMissingError


def load(module: str, *, extra: str) -> ModuleType:
    """Import a module of sjerk that needs ``sjerk[extra]``; raises ExtraMissingError.

    >>> load("sjerk.profile", extra="none").__name__
    'sjerk.profile'
    """
    try:
        return importlib.import_module(module)
    except ImportError as fault:
        missing = (fault.name or module).partition(".")[0]
        raise ExtraMissingError(missing, extra) from fault
