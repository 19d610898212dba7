"""Who may come in: one secret per role, checked before anything is served.

viser binds where it is told, and checks neither Host nor Origin nor any secret; it takes the
address of another server from a link, and messages of 50 MB. All of that is decided here, at the
door of its web server. Never here: what a browser may order (``lead.py``).
"""

from __future__ import annotations

import base64
import contextlib
import contextvars
import functools
import gzip
import hmac
import http
import http.client
import os
import secrets
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Literal
from urllib.parse import urlsplit

import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Response

from sjerk.errors import SjerkError
from sjerk.ports.panel.page_scripts import SCRIPTS

Role = Literal["lead", "view"]

#: Of the page: scripts and styles are its own, and it may talk to nobody but us. It compiles no
#: text (unsafe-eval): viser's sorter of splats wants to, finds that it may not, and is not needed.
_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "worker-src 'self' blob: data:; connect-src 'self' ws://{host} data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
#: A browser that does not answer so long (s) has left; the largest message of one, bytes.
_PING, _PATIENCE, _LARGEST = 1.0, 1.5, 2**20

#: Of the connection in whose task this is read.
_role: contextvars.ContextVar[Role | None] = contextvars.ContextVar("role", default=None)


_OTHER_KIND = "this version of viser is of another kind"


class DoorOpenError(SjerkError):
    """The web server lets in whoever has no secret: nothing may run on it."""


class Door:
    """The secret is the path of the page: its websocket has it too, and no other port ever gets it.

    ``lead``: whether there is a link that leads. ``tell`` gets a line for each that is turned away.
    """

    def __init__(self, *, lead: bool = True, tell: Callable[[str], None] | None = None) -> None:
        self._secrets: dict[str, Role] = {secrets.token_urlsafe(24): "view"}
        if lead:
            self._secrets[secrets.token_urlsafe(24)] = "lead"
        self._tell = tell
        self.refused: deque[str] = deque(maxlen=100)

    def link(self, port: int, role: Role) -> str | None:
        """The address of the page for a role; None: there is none."""
        for secret, own in self._secrets.items():
            if own == role:
                return f"http://127.0.0.1:{port}/{secret}/"
        return None

    def role_of(self, path: str) -> Role | None:
        """The role whose secret the path of a request has."""
        given, found = urlsplit(path).path.strip("/").encode(), None
        for secret, role in self._secrets.items():  # all of them, whichever it is
            if hmac.compare_digest(secret.encode(), given):
                found = role
        return found

    @staticmethod
    def current_role() -> Role | None:
        """The role of the connection whose message is being handled, on its event loop."""
        return _role.get()

    # ---- what is asked at the door

    def check(self, port: int, headers: Any, path: str) -> Any:
        """The answer that turns a request away; None: come in."""
        host = headers.get("Host", "")
        if host not in {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}:
            return self._no(http.HTTPStatus.MISDIRECTED_REQUEST, "another host is asked for")
        if self.role_of(path) is None:
            why = "open the address that `sjerk panel` has printed"
            return self._no(http.HTTPStatus.FORBIDDEN, why)
        if headers.get("Upgrade", "").lower() == "websocket":
            if headers.get("Origin") != f"http://{host}":
                return self._no(http.HTTPStatus.FORBIDDEN, "a page of another origin")
            return None
        split = urlsplit(path)
        if split.query or not split.path.endswith("/"):
            # ?websocket= would run another server's page in our origin
            to = split.path.rstrip("/") + "/"
            return self._no(http.HTTPStatus.SEE_OTHER, "nothing is taken from a link", Location=to)
        return None

    def _no(self, status: http.HTTPStatus, why: str, **more: str) -> Any:
        self.refused.append(why)
        if self._tell is not None and status is not http.HTTPStatus.SEE_OTHER:
            self._tell(f"turned away at the door: {why}")
        text = f"sjerk panel: {why}\n".encode()
        headers = Headers(
            {
                "Content-Type": "text/plain; charset=utf-8",
                "Content-Length": str(len(text)),
                "Connection": "close",
                **more,
            }
        )
        return Response(status.value, status.phrase, headers, text)

    # ---- the door itself

    @contextlib.contextmanager
    def hung(self) -> Iterator[None]:
        """While this holds, a web server that begins to serve asks here first."""
        module = websockets.asyncio.server
        serve = module.serve

        def guarded(handler: Any, host: Any, port: Any, **options: Any) -> Any:
            page = options.pop("process_request")

            def ask(connection: Any, request: Any) -> Any:
                own = connection.local_address[1]
                answer = self.check(own, request.headers, request.path)
                if answer is not None:
                    return answer
                if request.headers.get("Upgrade", "").lower() == "websocket":
                    return page(connection, request)
                request.path = "/"
                return _dressed(page(connection, request), request.headers["Host"])

            async def named(connection: Any) -> None:
                _role.set(self.role_of(connection.request.path))
                await handler(connection)

            options |= {"ping_interval": _PING, "ping_timeout": _PATIENCE, "max_size": _LARGEST}
            return serve(named, host, port, process_request=ask, **options)

        module.serve = guarded
        try:
            yield
        finally:
            module.serve = serve

    def prove(self, port: int) -> None:
        """Knock without a secret, as a page and as a websocket; raises DoorOpenError if let in.

        So that another version of viser cannot open the door unseen. With a secret the page must
        come with its policy, and be watchful; that also makes it ready for the first browser.
        """
        key = base64.b64encode(os.urandom(16)).decode()
        upgrade = {
            "Upgrade": "websocket",
            "Connection": "Upgrade",
            "Sec-WebSocket-Version": "13",
            "Sec-WebSocket-Key": key,
            "Origin": f"http://127.0.0.1:{port}",
        }
        tell, self._tell = self._tell, None  # it is us
        knocks = [_knock(port, "/", headers) for headers in ({}, upgrade)]
        self._tell = tell
        for status, _, _ in knocks:
            if status != http.HTTPStatus.FORBIDDEN:
                raise DoorOpenError(f"the door is open (answer {status}): {_OTHER_KIND}")
        secret = next(iter(self._secrets))
        _, answered, page = _knock(port, f"/{secret}/", {"Accept-Encoding": "gzip"})
        if answered.get("Content-Encoding") == "gzip":
            page = gzip.decompress(page)
        policy = answered.get("Content-Security-Policy", "")
        if "connect-src 'self'" not in policy or SCRIPTS not in page:
            raise DoorOpenError(f"the page has no policy: {_OTHER_KIND}")


def _knock(
    port: int, path: str, headers: dict[str, str]
) -> tuple[int, http.client.HTTPMessage, bytes]:
    """Status, headers and body of an answer; of a websocket that is let in no body."""
    knock = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
    try:
        knock.request("GET", path, headers={"Connection": "close"} | headers)
        with knock.getresponse() as answer:
            body = b"" if answer.status == http.HTTPStatus.SWITCHING_PROTOCOLS else answer.read()
            return answer.status, answer.headers, body
    finally:
        knock.close()


@functools.lru_cache(maxsize=8)
def _with_scripts(body: bytes, packed: bool) -> bytes:
    """The page with words of ours before its own."""
    page = gzip.decompress(body) if packed else body
    page = page.replace(b"<head>", b"<head>" + SCRIPTS, 1)
    return gzip.compress(page) if packed else page


def _dressed(answer: Any, host: str) -> Any:
    """The page with its policy."""
    if answer is None:
        return None
    answer.body = _with_scripts(answer.body, answer.headers.get("Content-Encoding") == "gzip")
    del answer.headers["Content-Length"]
    answer.headers["Content-Length"] = str(len(answer.body))
    answer.headers["Content-Security-Policy"] = _POLICY.format(host=host)
    for name, value in _HEADERS.items():
        answer.headers[name] = value
    return answer
