"""A workbench that stands still, in Chromium: by how far what is dragged, by mouse or fingertip, and all else moves."""

import itertools

import pytest

from tactuator.console.page_server import build_console
from tactuator.console.state import ConsoleState
from tests.browser import drawn
from tests.console.pages import TOKEN, address_of, go
from tests.console.test_chromium import ONE, SETTLED, gain_text, page, shape  # noqa: F401
from tests.web.server import served

PULL = 40.0
ASLANT = [(PULL, -PULL), (-PULL, PULL)]
"""Right and up, and left and down: each pull goes along both axes."""
SMALLER = [pytest.param(*size, marks=pytest.mark.soak) for size in ((1024, 768), (390, 844))]
SIZED = pytest.mark.parametrize(("wide", "high"), [(1440, 900), *SMALLER])
NEAR_PX = 3.0
"""By how far a handle may be from where the pointer has taken it: places are drawn to a tenth, frequencies in steps."""
POINTS = "[aria-label^='Threshold at']"
PARTS = "h1, #channel, .bar button, .limits, .tiles, .tiles > div, .head, .plot, .legend, .panel, svg.nichols, .u-over"
PLACES = """(parts) => Object.fromEntries([...document.querySelectorAll(parts)].map((one, i) => [
    `${i} ${one.id || one.tagName} ${one.querySelector('dt, h2, h3')?.textContent ?? ''}`,
    one.getBoundingClientRect().toJSON()]))"""


def middle(page, handle):
    box = page.locator(handle).bounding_box()
    return box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0


def still(before, after):
    """Return what has another place or size."""
    assert list(before) == list(after)
    sides = ("x", "y", "width", "height")
    return [name for name in before if any(abs(before[name][at] - after[name][at]) > 0.6 for at in sides)]


def pulled(page, handle, along, down, settled):
    """Drag a handle; return by how far it moved and what else did, while it was still held, and let it go."""
    page.locator(handle).scroll_into_view_if_needed()
    page.mouse.move(1, 1)
    (x, y), before = middle(page, handle), page.evaluate(PLACES, PARTS)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + along, y + down, steps=2)
    settled()
    (to_x, to_y), after = middle(page, handle), page.evaluate(PLACES, PARTS)
    page.mouse.up()
    return (to_x - x, to_y - y), still(before, after)


def view(page, name, wide, high, there):
    """Open a view in a window of this size; return what waits until it stands."""
    page.set_viewport_size({"width": wide, "height": high})
    go(page, name, display="file")
    page.wait_for_selector(there)

    def settled():
        drawn(page)  # what was pulled has been asked for
        page.wait_for_selector(there)

    return settled


def undone(page, settled, before):
    page.keyboard.press("Control+z")
    settled()
    assert shape(page) == before


@pytest.mark.slow
@SIZED
def test_loop__each_handle_pulled_by_40_px__moves_what_is_dragged_and_nothing_else(page, wide, high):
    settled = view(page, "loop", wide, high, SETTLED)
    whole, chart = (page.locator(part).bounding_box() for part in (".bench .plots", "svg.nichols"))
    if wide >= 1440:
        assert whole["y"] + whole["height"] <= high
    else:
        assert chart["y"] + min(chart["height"], 300.0) <= high
    marks = page.locator(".nichols g:not([visibility=hidden]) > .mark").count()
    assert marks >= 6
    handles = [f".nichols g:not([visibility=hidden]) > .mark >> nth={k}" for k in range(marks)]
    # a mark that 40 px would take out of the chart is hidden there, and has no place to be compared
    chart = page.locator("svg.nichols .axis").first.bounding_box()
    edges = chart["y"] + PULL + 5.0, chart["y"] + chart["height"] - PULL - 5.0
    handles = [handle for handle in handles if edges[0] < middle(page, handle)[1] < edges[1]]
    assert len(handles) >= 5
    straight_up = (handles[0], (0.0, -PULL))  # it alone turns nothing
    for handle, (along, down) in [*zip(handles[::3], itertools.cycle(ASLANT), strict=False), straight_up]:
        before = shape(page)
        by, moved = pulled(page, handle, along, down, settled)
        assert (by, moved) == (pytest.approx((along, down), abs=NEAR_PX), []), (handle, along, down)
        after = shape(page)
        kept = [one for one in after["factors"] if one["kind"] != "lead"]
        assert kept == before["factors"], (handle, along, down)
        assert (len(after["factors"]) > len(before["factors"])) == (along != 0.0), (handle, along, down)
        undone(page, settled, before)


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


def level_db(page, point):
    return float(page.locator(point).get_attribute("aria-valuenow"))


@pytest.mark.slow
def test_handles_marks_and_points__under_a_fingertip__follow_it_and_the_page_stays(phone):
    page, drag = phone
    go(page, "loop", display="file")
    page.wait_for_selector(SETTLED)
    before, said = shape(page)["gain_db"], gain_text(page)
    box, scrolls = drag(".handle.gain", 0, 40)
    assert min(box["width"], box["height"]) >= LEAST_PX
    page.wait_for_selector(f".handle.gain:not([aria-valuetext='{said}'])")
    page.wait_for_selector(SETTLED)
    assert shape(page)["gain_db"] > before + 8.0
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
