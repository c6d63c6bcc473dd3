"""The console in a real Chromium, by keyboard alone: a loop is designed, changed, undone, kept, checked and saved."""

import json
from urllib.parse import parse_qs

import pytest

from tactuator.cli.main import main
from tactuator.console.app import build_console
from tactuator.console.state import ConsoleState
from tests.console.pages import ONE, TOKEN, console_page, pressed, tab_to
from tests.web.server import served

SETTLED = ".tiles[aria-busy=false]"


@pytest.fixture
def page(browser, tmp_path):
    """The start page of a console for a display of one channel; what the browser complains of is kept."""
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


@pytest.mark.slow
def test_loop__by_keyboard_alone__is_designed_changed_and_saved_as_check_judges_it(page, tmp_path):
    to_the_loop(page)
    assert "token" not in page.url
    pressed(page, "button.first", "code:has-text('tactuator design')")
    page.wait_for_selector(SETTLED)
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Check and save"
    page.keyboard.press("Enter")
    page.wait_for_selector("#save:focus")
    with page.expect_download() as download:
        page.keyboard.press("Enter")
    download.value.save_as(tmp_path / "saved.json")
    assert main(["design", str(tmp_path / "display.toml"), "--out", str(tmp_path / "designed.json"), "--json"]) == 0
    assert (tmp_path / "saved.json").read_bytes() == (tmp_path / "designed.json").read_bytes()


def test_handles__by_keyboard__change_what_they_say_and_undo_takes_it_back(page):
    to_the_loop(page)
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


@pytest.mark.slow
def test_mark__of_the_curve_by_keyboard__rises_by_half_a_decibel(page):
    to_the_loop(page)
    mark = page.locator("[aria-label^='Point of the curve at 20 Hz']")
    before = float(mark.get_attribute("aria-valuenow"))
    mark.focus()
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector(SETTLED)
    assert float(mark.get_attribute("aria-valuenow")) == pytest.approx(before + 0.5, abs=0.11)
    assert shape(page)["factors"][-1]["kind"] == "lead"


@pytest.mark.slow
def test_value__out_of_range_or_improper__is_told_and_nothing_is_lost(page):
    to_the_loop(page)
    before = shape(page)
    page.locator("#gain").fill("900")
    page.keyboard.press("Enter")
    page.wait_for_selector("#banner:has-text('gain_db is 900; allowed: -200 to 200')")
    assert page.locator("#gain").input_value() == f"{before['gain_db']:.2f}"
    page.locator("#gain").fill("")
    page.keyboard.press("Enter")
    page.wait_for_selector(".wrong:has-text('empty; allowed: a number')")
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
        with tabs.expect_page() as opened:
            made.locator("#to-display").click(modifiers=["Control"])
        opened.value.wait_for_selector("body[data-ready=display] h1")
        assert made.locator("#banner").is_hidden()
        tabs.close()
