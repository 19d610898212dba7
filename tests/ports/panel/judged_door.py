"""The door of the panel: every attack is held, and succeeds where the door is off."""

from __future__ import annotations

import http.client
import re
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import viser
import websockets.exceptions

from helpers.panel_client import Client, PanelProcess, panel, until
from sjerk.ports.panel.door import Door, DoorOpenError

ON, OFF = "door", "no door"


@pytest.fixture(scope="module")
def panels(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, PanelProcess]]:
    """Two panels on one kernel each."""
    folder = tmp_path_factory.mktemp("panels")
    with (
        panel(name=f"door-on-{time.time_ns()}", folder=folder) as one,
        panel(name=f"door-off-{time.time_ns()}", folder=folder, door=False) as two,
    ):
        yield {ON: one, OFF: two}


def get(
    port: int, path: str, *, host: str | None = None
) -> tuple[int, http.client.HTTPMessage, bytes]:
    """One request for a page."""
    door = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    door.request("GET", path, headers={"Host": host or f"127.0.0.1:{port}"})
    answer = door.getresponse()
    found = answer.status, answer.headers, answer.read()
    door.close()
    return found


def enters(link: str, **options: str) -> bool:
    """Whether a websocket is let in."""
    try:
        Client(link, **options).close()
    except websockets.exceptions.InvalidStatus:
        return False
    return True


def of_another_user(target: PanelProcess) -> bool:
    """The page without the secret."""
    return get(target.port, "/")[0] == 200


def socket_of_another_user(target: PanelProcess) -> bool:
    """The websocket without the secret."""
    return enters(f"http://127.0.0.1:{target.port}/")


def socket_of_another_page(target: PanelProcess) -> bool:
    """A page of somebody else in the user's browser, which may have seen the secret."""
    return enters(target.lead, origin="http://evil.example")


def socket_without_origin(target: PanelProcess) -> bool:
    """A program that gives none."""
    return enters(target.lead, origin=None)  # type: ignore[arg-type]


def rebound_name(target: PanelProcess) -> bool:
    """DNS rebinding: another name that leads to 127.0.0.1."""
    path = urlsplit(target.view).path
    return get(target.port, path, host=f"evil.example:{target.port}")[0] == 200


def another_server_in_a_link(target: PanelProcess) -> bool:
    """?websocket= runs the page of another server in our origin."""
    path = urlsplit(target.view).path
    return get(target.port, f"{path}?websocket=ws://evil.example")[0] == 200


def framed(target: PanelProcess) -> bool:
    """Clickjacking: the page in a frame of another."""
    headers = get(target.port, urlsplit(target.view).path)[1]
    return "frame-ancestors 'none'" not in headers.get("Content-Security-Policy", "")


def talks_to_others(target: PanelProcess) -> bool:
    """A script in the page may send what it knows elsewhere."""
    headers = get(target.port, urlsplit(target.view).path)[1]
    found = re.search(r"connect-src ([^;]*)", headers.get("Content-Security-Policy", ""))
    return found is None or f"ws://127.0.0.1:{target.port}" not in found.group(1)


def kept_by_caches(target: PanelProcess) -> bool:
    """The page, and with it the secret, stays on a disk or is told to others."""
    headers = get(target.port, urlsplit(target.view).path)[1]
    return (headers.get("Cache-Control"), headers.get("Referrer-Policy")) != (
        "no-store",
        "no-referrer",
    )


def frozen(target: PanelProcess) -> bool:
    """A browser that answers no ping stays as if it were there."""
    link = urlsplit(target.view)
    with socket.create_connection(("127.0.0.1", target.port)) as raw:
        raw.sendall(
            (
                f"GET {link.path} HTTP/1.1\r\nHost: {link.netloc}\r\nOrigin: http://{link.netloc}\r\n"
                "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
                f"Sec-WebSocket-Protocol: viser-v{viser.__version__}\r\n\r\n"
            ).encode()
        )
        raw.settimeout(0.5)
        end = time.monotonic() + 8.0
        while time.monotonic() < end:
            try:
                if not raw.recv(2**16):
                    return False
            except TimeoutError:
                continue
            except ConnectionError:
                return False
    return True


def huge(target: PanelProcess) -> bool:
    """A message of many megabytes is taken."""
    client = Client(target.view)
    try:
        client.send(type="GuiUpdateMessage", uuid="x" * 2**22, updates={})
        return not client.closed.wait(3.0)
    except (websockets.exceptions.ConnectionClosed, OSError):
        return False
    finally:
        client.close()


ATTACKS = [
    of_another_user,
    socket_of_another_user,
    socket_of_another_page,
    socket_without_origin,
    rebound_name,
    another_server_in_a_link,
    framed,
    talks_to_others,
    kept_by_caches,
    frozen,
    huge,
]


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.__name__)
def test_an_attack_is_held_and_succeeds_without_the_door(
    panels: dict[str, PanelProcess], attack: object
) -> None:
    """Both are seen, so that the attack is one."""
    assert callable(attack)
    assert attack(panels[OFF])
    assert not attack(panels[ON])


def test_a_guessed_secret_opens_nothing(panels: dict[str, PanelProcess]) -> None:
    """Of the right length, or a part of it, or more."""
    secret = urlsplit(panels[ON].view).path
    for path in (f"/{'A' * 32}/", secret[:-2] + "/", secret[:-1] + "A/", secret + secret):
        assert get(panels[ON].port, path)[0] == 403
    assert get(panels[ON].port, secret)[0] == 200


def test_nobody_else_can_reach_the_port(panels: dict[str, PanelProcess]) -> None:
    """It listens on the loopback address only."""
    port = f"{panels[ON].port:04X}"
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = [row[1] for row in rows if row[1].endswith(f":{port}") and row[3] == "0A"]
    assert listening == [f"0100007F:{port}"]


def test_a_door_that_lets_anyone_in_ends_the_panel(panels: dict[str, PanelProcess]) -> None:
    """The proof at the start, against viser as it comes, and against a page without a policy."""
    with pytest.raises(DoorOpenError, match=r"the door is open \(answer 200\)"):
        Door().prove(panels[OFF].port)
    with pytest.raises(DoorOpenError, match="no policy"):
        Door().prove(panels[ON].port)  # another door's secret opens nothing, so there is no page


def test_a_link_to_view_gives_no_order_and_a_link_to_lead_is_not_made_where_unwanted() -> None:
    """Roles by secrets; every one of them is compared."""
    door = Door()
    lead, view = door.link(1, "lead"), door.link(1, "view")
    assert lead is not None
    assert view is not None
    assert lead != view
    assert door.role_of(urlsplit(lead).path) == "lead"
    assert door.role_of(urlsplit(view).path) == "view"
    assert door.role_of("/") is None
    assert Door(lead=False).link(1, "lead") is None


def test_a_public_tunnel_is_refused_and_told(panels: dict[str, PanelProcess]) -> None:
    """Any browser may ask viser for one."""
    client = Client(panels[ON].view)
    client.send(type="ShareUrlRequest")
    client.told("a public tunnel was asked for: refused")
    client.close()


def test_a_browser_cannot_reach_the_elements_of_another(panels: dict[str, PanelProcess]) -> None:
    """Nor change a shared one: there are only outputs."""
    one, two = Client(panels[ON].lead), Client(panels[ON].view)
    slider = one.find("Velocity")
    first = next(u for u, p in one.props.items() if "sjerk-first" in str(p.get("content", "")))
    changed: list[object] = []
    one.on_message = lambda message: (
        changed.append(message) if message.get("updates", {}).get("removed") else None
    )
    for uuid in (slider, first):
        two.send(type="GuiUpdateMessage", uuid=uuid, updates={"removed": True, "value": 1e9})
    shown = one.props[first]["content"]
    until(lambda: one.props[first]["content"] != shown, "the page of the other lives")
    assert changed == []
    assert one.props[slider]["value"] == 0.3
    one.close()
    two.close()
