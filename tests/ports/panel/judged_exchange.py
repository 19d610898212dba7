"""What a page says to the panel arrives: all of it, in order, from the first moment on."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser

from helpers.panel_client import Client, PanelProcess, panel, until
from helpers.panel_page import Seen, needs_browser


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelProcess]:
    """A panel, and the kernel that it has started."""
    folder = tmp_path_factory.mktemp("exchange")
    with panel(name=f"exchange-{time.time_ns()}", folder=folder) as process:
        yield process


def test_what_is_pressed_as_soon_as_it_is_there_is_answered(running: PanelProcess) -> None:
    """A page comes whole: no button is seen before somebody listens to it."""
    for _ in range(5):
        client = Client(running.lead)

        def at_once(message: dict[str, Any], client: Client = client) -> None:
            if message.get("props", {}).get("label") == "Take the lead":
                client.send(type="GuiUpdateMessage", uuid=message["uuid"], updates={"value": True})

        client.on_message = at_once
        client.told("this browser leads")
        client.close()
        viewer = Client(running.view)
        viewer.told("leads: <b>nobody</b>")
        viewer.close()


@pytest.fixture
def leader(running: PanelProcess) -> Iterator[Client]:
    """A page without a browser, which leads; the scene is as it was before."""
    client = Client(running.lead)
    client.told("leads: <b>nobody</b>")
    client.order("Take the lead", "this browser leads")
    yield client
    client.close()


def test_what_follows_a_choice_is_done_before_what_is_typed_next(leader: Client) -> None:
    """A shape is chosen, and fills the fields; a name typed after it is the one that is added."""
    known = leader.props[leader.find("Shape")]["options"]
    chosen = itertools.cycle(known)
    for number in range(30):
        name = f"next {number}"
        leader.set("Shape", next(chosen))
        leader.set("Name", name, nth=1)
        leader.order("Add or change", " is in the scene")
        assert leader.said == f"{name} is in the scene"
        leader.set("Shape", next(chosen))
        leader.set("Name", name, nth=1)
        leader.order("Remove", " is removed")
        assert leader.said == f"{name} is removed"


def test_sliders_go_along_with_the_goal(leader: Client) -> None:
    """By a pose, and by what other tabs make the goal; so the next drag moves one joint only."""

    def at() -> float:
        return float(leader.props[leader.find("panda_joint1")]["value"])

    leader.set("Pose", "left")
    leader.set("To goal", "Set goal")
    until(lambda: at() == 0.9, "the pose")
    leader.order("To its first point", "first point: plan and execute")
    until(lambda: at() == 0.0, "the first point")


ADDED = """([name, place, button]) => {
    const value = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value');
    const type = (field, words) => {
        value.set.call(field, words);
        field.dispatchEvent(new Event('input', {bubbles: true}));
        field.dispatchEvent(new FocusEvent('focusout', {bubbles: true}));
    };
    type(...name);
    for (const [field, words] of place) type(field, words);
    button.click();
}"""


@needs_browser
def test_what_is_typed_is_there_when_the_button_is_pressed(
    browser: Browser, running: PanelProcess
) -> None:
    """However fast, or however slow the page: a name, three numbers and a click of one moment."""
    seen = Seen(browser, running.lead)
    seen.lead()
    seen.tab("Scene")
    seen.choose("Shape", "(new)")
    for number, name in enumerate(("one", "two", "three")):
        fields = seen.beside("Place [m]", "input[not(@type='hidden')]")
        place = [0.1 * (number + 1), 0.2, 2.5]
        seen.page.evaluate(
            ADDED,
            [
                [seen.beside("Name", "input").first.element_handle(), name],
                [[fields.nth(k).element_handle(), str(v)] for k, v in enumerate(place)],
                seen.button("Add or change").element_handle(),
            ],
        )
        seen.until(lambda name=name: seen.said == f"{name} is in the scene", name)
    seen.choose("Shape", "two")
    fields = seen.beside("Place [m]", "input[not(@type='hidden')]")
    seen.until(lambda: fields.nth(0).input_value() == "0.2", "it is where it was put")
    assert [fields.nth(k).input_value() for k in range(3)] == ["0.2", "0.2", "2.5"]
    assert seen.faults == []
    seen.page.close()
