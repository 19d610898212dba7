"""A browser without a screen: the messages of viser's page over a websocket of its own.

It sends what it wants, so it is also who attacks. Wire format as in viser 1.1 (infra/_infra.py).
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import viser
import websockets.exceptions
import zstandard
from websockets.sync.client import connect

from helpers.root import program

PATIENCE = 30.0


def until(what: Callable[[], Any], why: str, patience: float = PATIENCE) -> Any:
    """Wait for something to be true, and return it."""
    end = time.monotonic() + patience
    while not (found := what()):
        assert time.monotonic() < end, f"not within {patience} s: {why}"
        time.sleep(0.01)
    return found


class PanelProcess:
    """``sjerk panel`` in a process, with the kernel it has started."""

    def __init__(self, *arguments: str, name: str, folder: Path, door: bool = True) -> None:
        words = ["panel", "--json", "--port", "0", "--name", name, *arguments]
        command = [sys.executable, "-m", "sjerk", *words]
        if not door:
            command = program("helpers.panel_without_door", *words)
        self.name = name
        self.process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.links: dict[str, Any] = json.loads(self.process.stdout.readline())
        self.port = urlsplit(self.links["view"]).port

    @property
    def lead(self) -> str:
        """The link that leads."""
        return str(self.links["lead"])

    @property
    def view(self) -> str:
        """The link that views."""
        return str(self.links["view"])

    def kill(self) -> None:
        """At once, whatever it does."""
        self.process.kill()
        self.close()

    def close(self) -> int:
        """As Ctrl-C does; the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        code = self.process.wait(PATIENCE)
        if self.process.stdout is not None:
            self.process.stdout.close()
        return code


@contextmanager
def panel(*arguments: str, name: str, folder: Path, door: bool = True) -> Iterator[PanelProcess]:
    """A panel for a test."""
    process = PanelProcess(*arguments, name=name, folder=folder, door=door)
    try:
        yield process
    finally:
        process.close()


class Client:
    """One connection to a page; elements are found by their labels."""

    def __init__(self, link: str, **options: Any) -> None:
        split = urlsplit(link)
        uri = f"ws://{split.netloc}{split.path}"
        options = {"origin": f"http://{split.netloc}", "ping_interval": None} | options
        self.socket = connect(
            uri,
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            compression=None,
            max_size=None,
            **options,
        )
        self.elements: list[tuple[str, str, str]] = []  # type, label, uuid
        self.props: dict[str, dict[str, Any]] = {}
        self.scene: dict[str, dict[str, Any]] = {}
        self.nodes: dict[str, dict[str, Any]] = {}  # of the scene, as they were made
        self.frames = 0
        self.bytes = 0
        self.on_message: Callable[[dict[str, Any]], None] = lambda message: None
        self.closed = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        self.camera()

    def close(self) -> None:
        """Leave, as a closed page does."""
        with suppress(Exception):
            self.socket.close()
        self._thread.join(PATIENCE)

    def _read(self) -> None:
        unpack = zstandard.ZstdDecompressor()
        try:
            for raw in self.socket:
                assert isinstance(raw, bytes)
                size = int.from_bytes(raw[8:16], "little")
                window = msgspec.msgpack.decode(unpack.decompress(raw[16 : 16 + size]))
                self.frames += 1
                self.bytes += len(raw)
                for message in window["messages"]:
                    self._take(message)
        except (websockets.exceptions.WebSocketException, OSError, ValueError):
            pass
        finally:
            self.closed.set()

    def _take(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "GuiUpdateMessage":
            self.props.setdefault(message["uuid"], {}).update(message["updates"])
        elif kind.startswith("Gui") and "props" in message:
            props = dict(message["props"])
            if "value" in message:
                props["value"] = message["value"]
            self.props[message["uuid"]] = props
            self.elements.append((kind, str(props.get("label", "")), message["uuid"]))
        elif "name" in message and "props" in message:
            self.nodes[message["name"]] = message
        elif kind == "SceneNodeUpdateMessage":
            self.scene.setdefault(message["name"], {}).update(message["updates"])
        self.on_message(message)

    # ---- what a page sends

    def send(self, **message: Any) -> None:
        """One message, whatever it says."""
        self.socket.send(msgspec.msgpack.encode(message))

    def camera(self) -> None:
        """The first message of a page: then the panel knows it."""
        self.send(
            type="ViewerCameraMessage",
            wxyz=(1.0, 0.0, 0.0, 0.0),
            position=(1.0, 1.0, 1.0),
            fov=1.0,
            near=0.1,
            far=100.0,
            image_height=800,
            image_width=1280,
            look_at=(0.0, 0.0, 0.0),
            up_direction=(0.0, 0.0, 1.0),
        )

    def find(self, label: str, nth: int = 0) -> str:
        """The element with a label, once it is there."""

        def found() -> str | None:
            rows = [uuid for _, own, uuid in list(self.elements) if own == label]
            return rows[nth] if len(rows) > nth else None

        return str(until(found, f"an element {label!r}"))

    def has(self, label: str) -> bool:
        """Whether there is one now."""
        return any(own == label for _, own, _ in list(self.elements))

    def set(self, label: str, value: Any, nth: int = 0, **more: Any) -> None:
        """Give an input a value."""
        self.send(
            type="GuiUpdateMessage", uuid=self.find(label, nth), updates={"value": value} | more
        )

    def click(self, label: str, nth: int = 0) -> None:
        """Click a button, or let go of a held one."""
        self.set(label, True, nth)

    def hold(self, label: str) -> None:
        """One message of a held button."""
        self.send(type="GuiButtonHoldMessage", uuid=self.find(label), frequency=20.0)

    # ---- what a page shows

    @property
    def html(self) -> str:
        """All texts."""
        return "\n".join(str(p.get("content", "")) for p in list(self.props.values()))

    @property
    def said(self) -> str:
        """What was answered last."""
        for props in list(self.props.values()):
            found = re.search(r"class='sjerk-said'[^>]*>(.*?)</div>", str(props.get("content", "")))
            if found:
                return found.group(1)
        return ""

    @property
    def answers(self) -> int:
        """How many there were so far."""
        numbers = re.findall(r"class='sjerk-said' data-answer='(\d+)'", self.html)
        return max(map(int, numbers), default=0)

    def told(self, words: str) -> str:
        """Wait for an answer or a text."""
        until(lambda: self._has(words in self.html), f"{words!r} in the page")
        return self.said

    def _has(self, found: bool) -> bool:
        """Whether it is found; raises where it cannot come any more."""
        assert found or not self.closed.is_set(), f"the panel closed: {self.socket.close_reason}"
        return found

    def order(self, label: str, answer: str, value: Any = True, nth: int = 0) -> None:
        """Click, and wait for an answer that is new."""
        for props in list(self.props.values()):
            if "sjerk-said" in str(props.get("content", "")):
                props["content"] = ""
        self.set(label, value, nth)
        try:
            until(lambda: self._has(answer in self.said), f"{answer!r}")
        except AssertionError as fault:
            raise AssertionError(f"{fault}; it said {self.said!r}") from None
