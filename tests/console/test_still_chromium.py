"""A workbench that stands still, in Chromium: by how far each handle, its value and everything else moves in a drag."""

import pytest

from tests.console.pages import go
from tests.console.test_chromium import SETTLED, page, shape  # noqa: F401

SIZES = [(1440, 900), *(pytest.param(*size, marks=pytest.mark.soak) for size in ((1024, 768), (390, 844)))]
PULL = 40.0
DIRECTIONS = {"right": (PULL, 0.0), "left": (-PULL, 0.0), "up": (0.0, -PULL), "down": (0.0, PULL)}
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
    for step in range(1, 9):
        page.mouse.move(x + along * step / 8.0, y + down * step / 8.0)
        page.wait_for_timeout(15)
    settled()
    (to_x, to_y), after = middle(page, handle), page.evaluate(PLACES, PARTS)
    page.mouse.up()
    return (to_x - x, to_y - y), still(before, after)


@pytest.mark.slow
@pytest.mark.parametrize(("wide", "high"), SIZES)
def test_loop__each_handle_pulled_by_40_px__moves_what_is_dragged_and_nothing_else(page, wide, high):
    settled = loop_view(page, wide, high)
    whole = page.locator(".bench .plots").bounding_box()
    if wide >= 1440:
        assert whole["y"] + whole["height"] <= high
    else:
        chart = page.locator("svg.nichols").bounding_box()
        assert chart["y"] + min(chart["height"], 300.0) <= high
    marks = page.locator(".nichols g:not([visibility=hidden]) > .mark").count()
    assert marks >= 6
    handles = [f".nichols g:not([visibility=hidden]) > .mark >> nth={k}" for k in range(marks)]
    # a mark that 40 px would take out of the chart is hidden there, and has no place to be compared
    chart = page.locator("svg.nichols .axis").first.bounding_box()
    edges = chart["y"] + PULL + 5.0, chart["y"] + chart["height"] - PULL - 5.0
    handles = [handle for handle in handles if edges[0] < middle(page, handle)[1] < edges[1]]
    assert len(handles) >= 5
    for handle in handles:
        for way, (along, down) in DIRECTIONS.items():
            before = shape(page)
            (x, y), moved = pulled(page, handle, along, down, settled)
            assert (x, y) == pytest.approx((along, down), abs=NEAR_PX), (handle, way)
            assert moved == [], (handle, way)
            after = shape(page)
            kept = [one for one in after["factors"] if one["kind"] != "lead"]
            assert kept == before["factors"], (handle, way)
            assert (len(after["factors"]) > len(before["factors"])) == (along != 0.0), (handle, way)
            undone(page, settled, before)


def loop_view(page, wide, high):
    """Open the loop in a window of this size; return what waits until it stands."""
    page.set_viewport_size({"width": wide, "height": high})
    go(page, "loop", display="file")
    page.wait_for_selector(SETTLED)

    def settled():
        page.wait_for_timeout(120)
        page.wait_for_selector(SETTLED)

    return settled


def undone(page, settled, before):
    page.keyboard.press("Control+z")
    settled()
    assert shape(page) == before


@pytest.mark.slow
@pytest.mark.parametrize(("wide", "high"), SIZES)
def test_handles_on_the_open_loop__pulled_by_40_px__move_their_own_value_alone(page, wide, high):
    settled = loop_view(page, wide, high)
    for nth, name in enumerate(["gain", "zero", "pole"]):
        for way, (along, down) in DIRECTIONS.items():
            before = shape(page)
            (x, y), moved = pulled(page, f".handle >> nth={nth}", along, down, settled)
            assert moved == [], (name, way)
            after = shape(page)
            changed = [key for key in ("gain_db", "factors") if after[key] != before[key]]
            if name == "gain":
                assert changed == (["gain_db"] if down else []), way
                assert (x, y) == pytest.approx((0.0, down), abs=NEAR_PX), way
            else:
                assert changed == (["factors"] if along else []), (name, way)
                assert x == pytest.approx(along, abs=NEAR_PX), (name, way)
                others = [[one for k, one in enumerate(of["factors"]) if k != nth] for of in (before, after)]
                assert others[0] == others[1], (name, way)
            if changed:
                undone(page, settled, before)


@pytest.mark.slow
def test_value__typed_at_the_handle__is_the_handles(page):
    go(page, "loop", display="file")
    page.wait_for_selector(SETTLED)
    before = shape(page)
    page.locator(".handle >> nth=1").focus()
    page.keyboard.press("Enter")
    page.keyboard.type("7.5")
    page.keyboard.press("Enter")
    page.wait_for_function("location.hash.includes('%22hz%22%3A7.5')")
    page.wait_for_selector(SETTLED)
    assert shape(page)["factors"][1] == {"kind": "zero", "hz": 7.5}
    assert shape(page)["factors"][2] == before["factors"][2]
    mark = page.locator("[aria-label^='Point of the curve at 20 Hz']")
    mark.focus()
    page.keyboard.press("Enter")
    page.keyboard.type("-6")
    page.keyboard.press("Enter")
    page.wait_for_selector("[aria-label^='Point of the curve at 20 Hz'][aria-valuenow='-6.0']")


@pytest.mark.slow
@pytest.mark.parametrize(("wide", "high"), SIZES)
def test_prefilter__each_point_pulled_by_40_px__moves_up_and_down_alone(page, wide, high):
    page.set_viewport_size({"width": wide, "height": high})
    go(page, "prefilter", display="file")
    page.wait_for_selector("#error:has-text('Greatest error')")

    def settled():
        page.wait_for_timeout(100)
        page.wait_for_selector("#error[aria-busy=false]")

    count = page.locator(POINTS).count()
    assert count >= 20
    for nth in range(count):
        for way, (along, down) in DIRECTIONS.items():
            (x, y), moved = pulled(page, f"{POINTS} >> nth={nth}", along, down, settled)
            assert (x, y) == pytest.approx((0.0, down), abs=NEAR_PX), (nth, way)
            assert moved == [], (nth, way)
            if down:
                page.keyboard.press("Control+z")
                settled()
