"""The console on a touch screen: what a mouse drags, a fingertip drags, and beside it a fingertip scrolls the page."""

import pytest

from tactuator.console.app import build_console
from tactuator.console.state import ConsoleState
from tests.browser import drawn
from tests.console.pages import TOKEN, address_of, go
from tests.console.test_chromium import ONE, SETTLED, gain_text, shape
from tests.web.server import served

LEAST_PX = 24
"""The least size of what is touched, WCAG 2.2, criterion 2.5.8."""


@pytest.fixture
def phone(browser, tmp_path):
    """A console on a phone's screen, and a fingertip's drag: where it began, and by how much it scrolled."""
    display = tmp_path / "display.toml"
    display.write_text(ONE)
    with served(build_console(ConsoleState(display), TOKEN)) as client:
        context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
        page = context.new_page()
        page.set_default_timeout(60_000)
        page.goto(address_of(client))
        page.wait_for_selector("body[data-ready=start]")
        page.evaluate("window.cancelled = 0; addEventListener('pointercancel', () => { window.cancelled += 1; }, true)")
        touched = context.new_cdp_session(page)

        def drag(selector, along, up, steps=8):
            page.locator(selector).first.scroll_into_view_if_needed()
            box = page.locator(selector).first.bounding_box()
            x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
            cancelled, top = page.evaluate("[window.cancelled, scrollY]")

            def send(kind, points):
                touched.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

            send("touchStart", [{"x": x, "y": y}])
            for step in range(1, steps + 1):
                send("touchMove", [{"x": x + along * step / steps, "y": y - up * step / steps}])
                drawn(page)
            send("touchEnd", [])
            page.wait_for_timeout(100)
            by = page.evaluate("scrollY") - top
            return box, by if page.evaluate("window.cancelled") > cancelled else 0.0

        yield page, drag
        context.close()


def gain_db(page):
    return shape(page)["gain_db"]


def level_db(page, point):
    return float(page.locator(point).get_attribute("aria-valuenow"))


@pytest.mark.slow
def test_handles_marks_and_points__under_a_fingertip__follow_it_and_the_page_stays(phone):
    page, drag = phone
    go(page, "loop", display="file")
    page.wait_for_selector(SETTLED)
    before, said = gain_db(page), gain_text(page)
    box, scrolls = drag(".handle.gain", 0, 40)
    assert min(box["width"], box["height"]) >= LEAST_PX
    page.wait_for_selector(f".handle.gain:not([aria-valuetext='{said}'])")
    page.wait_for_selector(SETTLED)
    assert gain_db(page) > before + 8.0
    assert not scrolls
    assert drag("svg.nichols .axis", 0, 200)[1] > 100.0  # beside the curve it scrolls
    assert not drag("[aria-label^='Point of the curve at 20 Hz']", 25, 0)[1]
    page.wait_for_function("location.hash.includes('lead')")
    go(page, "prefilter", display="file")
    page.wait_for_selector("#error:has-text('Greatest error')")
    point = "[aria-label='Threshold at 20 Hz']"
    before = level_db(page, point)
    assert not drag(point, 0, 60)[1]
    page.wait_for_selector(f"{point}:not([aria-valuenow='{before:.1f}'])")
    page.wait_for_selector("#error[aria-busy=false]")
    assert level_db(page, point) > before + 5.0
