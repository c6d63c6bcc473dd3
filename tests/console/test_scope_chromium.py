"""The scope in a real Chromium, by keyboard alone: a simulated rig is begun, driven, touched, looked at and stopped."""

import os
import signal
import threading

import pytest

from tactuator.io.controller import read_controller
from tactuator.io.record import read_record
from tests.console.pages import address_of, opened_page, pressed, tab_to
from tests.console.test_accessibility_chromium import AXE, faults
from tests.console.test_still_chromium import ASLANT, NEAR_PX, pulled


def opened(browser, client):
    """Return the context of a console's scope in a page of its own."""
    return opened_page(browser, f"{address_of(client)}&view=scope", "scope")


@pytest.fixture
def page(browser, console):
    with opened(browser, console) as made:
        yield made


def begun(page, console):
    """Load the controller of the file and begin, by keyboard but for the choice of the file."""
    page.set_input_files("#controller-file", console.file)
    page.wait_for_selector("#live:not([disabled])")
    page.locator("#live").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("#rig-mode:has-text('live')")


def until(page, expression):
    """Wait until an expression is true; the page's own policy lets no string be waited for in it."""
    for _ in range(300):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(50)
    raise AssertionError(expression)


def frames_past(page, count=3):
    """Wait until so many more frames have been drawn."""
    before = page.evaluate("window.scopeFrames.length")
    until(page, f"window.scopeFrames.length >= {before + count}")


def still_but_for_the_cursor(page):
    """Pull each cursor by 40 px one way: it follows sideways, and nothing else moves."""
    for nth, (along, down) in enumerate(ASLANT):
        by, moved = pulled(page, f".cursor >> nth={nth}", along, down, lambda: frames_past(page, 1))
        assert (by, moved) == (pytest.approx((along, 0.0), abs=NEAR_PX), []), (nth, along, down)


@pytest.mark.slow
def test_scope__by_keyboard_alone__plays_is_touched_paused_saved_and_stopped(page, console, tmp_path):
    begun(page, console)
    tab_to(page, "#wave-level")
    page.keyboard.press("Control+a")
    page.keyboard.type("30")
    pressed(page, "#play", "#wave-now:has-text('tone at 30 dB SL on index, 100 Hz')")
    tab_to(page, "#touch-index")
    page.keyboard.press("ArrowDown")
    page.wait_for_selector("#levels small:has-text('at the tone')")
    until(page, "Math.abs(parseFloat(document.querySelector('#levels dd').textContent) - 30) < 2")
    assert console.host.status.touch["index"] == "finger"
    page.locator("#cursors").focus()
    page.keyboard.press("Enter")
    tab_to(page, ".cursor")
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_selector("#cursor-values:has-text('cursors: 70 ms apart')")
    still_but_for_the_cursor(page)
    page.locator("#pause").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("#pause:has-text('Go on')")
    traces = "document.querySelector('.traces canvas').clientHeight"
    usual = page.evaluate(traces)
    page.set_viewport_size({"width": 2560, "height": 1440})  # a display on a wall: it is drawn larger
    until(page, f"{traces} > 1.2 * {usual}")
    page.set_viewport_size({"width": 1366, "height": 900})
    page.evaluate(AXE)
    assert faults(page, {}) == []
    end = page.locator("#pause").get_attribute("data-row")
    with page.expect_download() as download:
        page.locator("#save-record").focus()
        page.keyboard.press("Enter")
    download.value.save_as(tmp_path / "index.csv")
    record = read_record(tmp_path / "index.csv")
    assert record.command.tolist() == pytest.approx(console.host.samples.rows(int(end) - 800, int(end))[:, 3].tolist())
    page.wait_for_selector("#play:has-text('Silence')")
    pressed(page, "#play", "#wave-now:has-text('silent')")
    until(page, "window.scopeLast.lost === 0")
    until(page, "document.querySelector('#levels small').textContent === 'sensor’s own hum, noise'")
    page.locator("#pause").focus()
    page.keyboard.press("Enter")
    frames_past(page)
    page.keyboard.press("Escape")
    page.wait_for_selector("#rig-mode:has-text('at rest')")


@pytest.mark.slow
def test_rig__of_two_pages__is_one_pages_waits_for_its_controller_and_is_opened_again_after_a_kill(
    page, browser, console, monkeypatch
):
    begun(page, console)
    with opened(browser, console) as other:
        other.wait_for_selector("#rig-held:has-text('another page has the controls')")
        assert other.locator("#play").is_disabled()
        frames_past(other)
        pressed(other, "#take")
        page.wait_for_selector("#rig-held:has-text('another page has the controls')")
        pressed(other, "#give")
    page.wait_for_selector("#rig-held:has-text('nobody has the controls')")
    pressed(page, "#take")
    pressed(page, "#stop", "#live:not([disabled])")
    may_come = threading.Event()

    def late(path):
        may_come.wait(30.0)
        return read_controller(path)

    with monkeypatch.context() as patched:  # what was begun before the file had come was ended by it, and stood still
        patched.setattr("tactuator.console.rig_session.read_controller", late)
        page.set_input_files("#controller-file", console.file)
        page.wait_for_selector("#live[disabled]")
        may_come.set()
        pressed(page, "#live", "#rig-mode:has-text('live')")
        frames_past(page)
    os.kill(console.host._process.pid, signal.SIGKILL)
    page.wait_for_selector("#rig-mode:has-text('the rig has gone')")
    page.wait_for_selector("#rig-more:has-text('open the rig again')")
    page.set_default_timeout(60_000)
    pressed(page, "#reopen", "#rig-mode:has-text('at rest')")
    begun(page, console)
    frames_past(page)
