"""``sjerk panel`` with its door taken off its hinges, to see that each attack succeeds then.

viser as it comes: nobody is asked for anything, and whoever comes leads.
"""

from __future__ import annotations

import contextlib
import sys

from sjerk.__main__ import main
from sjerk.ports.panel.door import Door

Door.hung = lambda self: contextlib.nullcontext()  # type: ignore[method-assign]
Door.prove = lambda self, port: None  # type: ignore[method-assign]
Door.link = lambda self, port, role: f"http://127.0.0.1:{port}/"  # type: ignore[method-assign]
Door.current_role = staticmethod(lambda: "lead")  # type: ignore[method-assign]

if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
