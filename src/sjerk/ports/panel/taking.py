"""A recording that a browser asks for: every cycle, to a file in the folder of the panel.

Never here: the layout of files.
"""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from pathlib import Path

from sjerk.errors import SjerkError
from sjerk.ports.panel.journal import Journal
from sjerk.recording import Recorder


class Taking:
    """At most one at a time, of the kernel ``name``; its file is named by the time of day."""

    def __init__(self, name: str, journal: Journal, *, any_owner: bool, folder: Path) -> None:
        self._name, self._journal, self._any_owner = name, journal, any_owner
        self._folder = folder
        self._lock = threading.Lock()
        self._open: ExitStack | None = None
        self._recorder: Recorder | None = None
        self.browser: int | None = None

    def begin(self, browser: int) -> Path:
        """Record from now on; raises SjerkError."""
        with self._lock:
            if self._open is not None:
                raise SjerkError("a recording goes on already")
            path = self._folder / f"sjerk-{time.strftime('%Y%m%d-%H%M%S')}.parquet"
            if path.exists():
                raise SjerkError(f"{path.name} exists: wait a second")
            stack = ExitStack()
            recorder = Recorder(self._name, path, any_owner=self._any_owner)
            self._recorder = stack.enter_context(recorder)
            self._open, self.browser = stack, browser
        self._journal.tell(f"browser {browser} records to {path}")
        return path

    def end(self) -> None:
        """The file is whole then; nothing where none is taken. Raises what went wrong."""
        with self._lock:
            stack, self._open = self._open, None
            recorder, self.browser = self._recorder, None
            if stack is None or recorder is None:
                return
            stack.close()
        self._journal.tell(f"recorded {recorder.cycles} cycles, {recorder.missed} missed")
