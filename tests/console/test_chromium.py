"""The loop's handles in a real Chromium, by keyboard: changed, undone, kept, refused; and a page without its token."""

import json
import threading
from urllib.parse import parse_qs

import pytest

from tactuator.console.page_server import build_console
from tactuator.console.state import ConsoleState
from tests.console.pages import ONE, TOKEN, console_page, go, pressed, tab_to
from tests.web.server import served

SETTLED = ".tiles[aria-busy=false]"


@pytest.fixture
def page(browser, tmp_path):
    path = tmp_path / "display.toml"
    path.write_text(ONE)
    with console_page(browser, path) as made:
        yield made


def shape(page):
    """Return the controller that the address holds: the page's own, since `page.url` is told of a change later."""
    return json.loads(parse_qs(page.evaluate("location.hash.slice(1)"))["shapes"][0])["index"]


def to_the_loop(page):
    pressed(page, ".cards a")
    page.wait_for_selector(SETTLED)


def gain_text(page):
    return page.locator(".handle.gain").get_attribute("aria-valuetext")


def test_handles__by_keyboard__change_what_they_say_and_undo_takes_it_back(page):
    to_the_loop(page)
    assert "token" not in page.url
    before, said = shape(page), gain_text(page)
    tab_to(page, ".handle.gain")
    page.keyboard.press("ArrowUp")
    page.wait_for_selector(f".handle.gain:not([aria-valuetext='{said}'])")
    assert shape(page)["gain_db"] == pytest.approx(before["gain_db"] + 0.5)
    page.keyboard.press("Tab")
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_selector(SETTLED)
    moved = shape(page)
    assert moved["factors"][1]["hz"] == pytest.approx(before["factors"][1]["hz"] * 1.02**5)
    page.keyboard.press("Delete")
    page.wait_for_selector(SETTLED)
    assert len(shape(page)["factors"]) == len(before["factors"]) - 1
    for _ in range(3):
        page.keyboard.press("Control+z")
        page.wait_for_selector(SETTLED)
    assert shape(page) == before
    page.reload()
    page.wait_for_selector(SETTLED)
    assert shape(page) == before
    mark = page.locator("[aria-label^='Point of the curve at 20 Hz']")
    level_db = float(mark.get_attribute("aria-valuenow"))
    mark.focus()
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector(SETTLED)
    assert float(mark.get_attribute("aria-valuenow")) == pytest.approx(level_db + 0.5, abs=0.11)
    assert shape(page)["factors"][-1]["kind"] == "lead"


@pytest.mark.slow
def test_value__typed_at_a_handle__is_taken_or_told_and_nothing_is_lost(page):
    to_the_loop(page)
    before = shape(page)
    for handle, value, there in (
        (".handle >> nth=1", "7.5", ".handle:not(.gain)[aria-valuetext*='7.5']"),
        ("[aria-label^='Point of the curve at 20 Hz']", "-6", "[aria-label^='Point'][aria-valuenow='-6.0']"),
    ):
        page.locator(handle).focus()
        page.keyboard.press("Enter")
        page.keyboard.type(value)
        page.keyboard.press("Enter")
        page.wait_for_selector(there)
        page.wait_for_selector(SETTLED)
    typed = shape(page)
    assert (typed["factors"][1], typed["factors"][2]) == ({"kind": "zero", "hz": 7.5}, before["factors"][2])
    for _ in range(2):
        page.keyboard.press("Control+z")
        page.wait_for_selector(SETTLED)
    assert shape(page) == before
    page.locator("#gain").fill("900")
    page.keyboard.press("Enter")
    page.wait_for_selector("#banner:has-text('gain_db is 900; it must be -200 to 200')")
    assert page.locator("#gain").input_value() == f"{before['gain_db']:.2f}"
    page.locator("#gain").fill("")
    page.keyboard.press("Enter")
    page.wait_for_selector(".wrong:has-text('empty: enter a number')")
    assert shape(page) == before
    page.locator("[aria-label='kind of factor']").select_option("zeros")
    page.locator("#add").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("text=more zeros than poles")
    page.locator("[aria-label='kind of factor']").select_option("notch")
    page.locator("#add").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("b:has-text('notch')")


def test_page__with_another_token__says_which_address_to_open(browser, tmp_path):
    with served(build_console(ConsoleState(), TOKEN)) as client:
        tabs = browser.new_context()
        made = tabs.new_page()
        made.goto(f"http://127.0.0.1:{client.port}/#token=another")
        made.wait_for_selector("#banner:has-text('no valid token')")
        made.evaluate("(hash) => { location.hash = hash; }", f"token={TOKEN}")  # the right one, pasted
        made.wait_for_selector("body[data-ready=start]")
        go(made, "scope")
        made.wait_for_selector("code:has-text('--rig simulated')")  # how to begin it with a rig
        opened = tabs.new_page()  # by the link's address: Chromium 150 crashes when any link is clicked with Control
        opened.goto(made.locator("#to-display").evaluate("link => link.href"))
        opened.wait_for_selector("body[data-ready=display] h1")
        assert made.locator("#banner").is_hidden()
        tabs.close()


def test_view__behind_a_long_request__has_its_title_while_it_waits(page, monkeypatch):
    held, opened = threading.Event(), ConsoleState.open
    monkeypatch.setattr(ConsoleState, "open", lambda *given: held.wait(60.0) and opened(*given))
    page.locator("#to-loop").click()
    page.wait_for_selector("#view h1:text-is('Loop') + p:text-is('Waiting for the server.')")
    assert page.locator(".cards").count() == 0
    held.set()
    page.wait_for_selector("body[data-ready=loop]")
    assert page.locator("text=Waiting for the server.").count() == 0
