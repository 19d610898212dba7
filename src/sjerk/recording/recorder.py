"""The recorder: every cycle of a kernel to a file, from the kernel's trace.

Never here: how a file is laid out, motion.
"""

from __future__ import annotations

import json
import threading
from contextlib import suppress
from pathlib import Path
from typing import Self

from sjerk.dpram.shortage import shortage
from sjerk.errors import InputError, positive
from sjerk.kernel import MotionKernel
from sjerk.kernel.trace import Chunk, Trace
from sjerk.recording import files
from sjerk.recording.recording import Recording
from sjerk.recording.tables import tables_of

_ROWS = 4096  # cycles of one piece of a file


class Recorder:
    """Records every cycle of a kernel: a running one by name, or one in a caller's own loop.

    The trace keeps some seconds of cycles, so a recorder that begins right after the kernel has its
    first cycle too, and one that is kept waiting loses none; what is lost is counted. To a file the
    memory it takes does not grow. A context manager; the file is whole once it is left.

    >>> from tempfile import TemporaryDirectory
    >>> from sjerk import Axis, Limits, Recording
    >>> kernel = MotionKernel([Axis(Limits(90.0, 500.0, 5000.0), 2**24 / 360)])
    >>> with TemporaryDirectory() as folder:
    ...     with Recorder(kernel, f"{folder}/a.parquet") as recorder:
    ...         kernel.step(100)
    ...     recorder.cycles, recorder.missed, len(Recording.open(f"{folder}/a.parquet"))
    (100, 0, 100)
    """

    def __init__(
        self,
        kernel: MotionKernel | str,
        path: Path | str | None,
        *,
        period: float = 0.02,
        any_owner: bool = False,
    ) -> None:
        """``path`` ends in ``.parquet`` or ``.mcap``; None keeps the cycles in memory.

        ``period`` in s: how often the trace is read. ``any_owner``: also of another user's kernel.

        Raises InputError, HandshakeError where no such kernel runs.
        """
        if not isinstance(kernel, MotionKernel | str):
            raise InputError("kernel", kernel, "must be a MotionKernel or the name of one")
        if path is not None and not isinstance(path, Path | str):
            raise InputError("path", path, "must be a path or None")
        self._period = positive("period", period)
        self._kernel = kernel if isinstance(kernel, MotionKernel) and not kernel.alive else None
        self.cycles = 0
        self.missed = 0
        self._chunks: list[Chunk] = []
        self._kept: list[Chunk] = []  # where there is no file
        self._path = None if path is None else Path(path)
        self._waiting = 0
        if self._kernel is not None:
            self._trace = Trace.of(self._kernel.trace_to(self.drain))
        else:
            name = kernel if isinstance(kernel, str) else kernel.name
            self._trace = Trace.attach(name, any_owner=any_owner)
        try:
            text = json.dumps(self._trace.description)
            self._file = None if self._path is None else files.writer(self._path, text)
        except BaseException as fault:
            self._release()
            if isinstance(fault, OSError):
                raise self._told(fault) from fault
            raise
        self._end = threading.Event()
        self._fault: Exception | None = None
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        """Begin; of a running kernel in a thread."""
        if self._kernel is None:
            self._thread = threading.Thread(target=self._follow, name="sjerk-recorder", daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Take what there is, and end the file. Raises what went wrong meanwhile."""
        self._end.set()
        if self._thread is not None:
            self._thread.join()
        else:
            self.drain()
        try:
            if self._fault is None:
                self._write()
                self._end_file()
        except Exception as fault:
            self._fault = self._told(fault)
        finally:
            self._release()
        if self._fault is not None:
            with suppress(Exception):  # it has said why already
                self._end_file()
            raise self._fault

    @property
    def fault(self) -> Exception | None:
        """What keeps it from recording on; leaving it raises that. None: all is well."""
        return self._fault

    @property
    def alive(self) -> bool:
        """Whether there is more to come: the kernel lives."""
        return self._trace.alive

    @property
    def recording(self) -> Recording:
        """What was recorded, once this is left."""
        if self._path is not None:
            return Recording.open(self._path)
        return Recording(self._trace.description, lambda: iter(self._kept))

    def _release(self) -> None:
        if self._kernel is not None:
            self._kernel.release_trace()
        self._trace.close()

    def _follow(self) -> None:
        try:
            while not self._end.is_set() and self._trace.alive:
                self.drain()
                self._end.wait(self._period)
            self.drain()
        except Exception as fault:
            self._fault = self._told(fault)

    def _told(self, fault: Exception) -> Exception:
        """A fault of the file, with its name."""
        if not isinstance(fault, OSError) or self._path is None:
            return fault
        missing = shortage(fault, str(self._path.resolve().parent))
        why = missing or fault.strerror or str(fault)
        limit = f"cannot be written after {self.cycles} cycles: {why}"
        told = InputError("file", str(self._path), limit)
        told.__cause__ = fault
        return told

    def _end_file(self) -> None:
        if self._file is not None:
            file, self._file = self._file, None
            file.close()

    def drain(self) -> None:
        """Take what the trace has now; it is called often enough by itself."""
        before = -1
        while before != self._trace.position:
            before = self._trace.position
            chunk = self._trace.read()
            if chunk is None:
                continue
            self._chunks.append(chunk)
            self.cycles += len(chunk.frames)
            self.missed += int(chunk.missed.sum())
            self._waiting += len(chunk.frames)
            if self._waiting >= _ROWS:
                self._write()

    def _write(self) -> None:
        if self._chunks:
            chunk = Chunk.joined(self._chunks, self._trace.axes)
            if self._file is None:
                self._kept.append(chunk)
            else:
                try:
                    self._file.write(tables_of(chunk))
                except OSError as fault:
                    raise self._told(fault) from fault
        self._chunks, self._waiting = [], 0
