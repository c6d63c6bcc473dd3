"""Every view of the console before axe-core (an npm package, unchanged; see docs/dependencies.md), in Chromium."""

from pathlib import Path

import pytest

from tactuator.console.page_connection import VIEWS
from tactuator.console.page_server import build_console
from tactuator.console.state import ConsoleState
from tests.console.pages import TOKEN, go
from tests.web.server import served

HERE = Path(__file__).parent
AXE = (HERE / "axe" / "axe.min.js").read_text("utf-8")
SOAK = pytest.mark.soak
LAPTOP, PHONE = {"width": 1366, "height": 800}, {"width": 390, "height": 844}
#: Every rule on a laptop, and the colours of the dark scheme on a phone; the soak has every rule and scheme on both.
COLOURS = {"runOnly": ["color-contrast", "scrollable-region-focusable"]}
LOOKS = [(LAPTOP, "light", {}), (PHONE, "dark", COLOURS)]
SETTLED = {"loop": ".tiles[aria-busy=false] > div", "prefilter": "#error:has-text('Greatest')", "display": "#use"}
CUT = """() => [...document.querySelectorAll(".tiles :is(dt, small), .factor input, main button")]
    .filter((one) => one.clientWidth && one.scrollWidth > one.clientWidth + 1).map((one) => one.outerHTML)
    .concat(document.documentElement.scrollWidth > innerWidth ? ["wider than the screen"] : [],
        document.querySelector(".plot, .maps")?.getBoundingClientRect().top > innerHeight - 150 ? ["no chart"] : [])"""
"""What is cut, and whether the first chart is in the first screen."""
#: What is there once the example of an empty view was taken.
FILLED = {"identify": "#tried", "speech": "button.saving"}


@pytest.fixture
def page(browser):
    with served(build_console(ConsoleState(), TOKEN)) as client:
        made = browser.new_page(viewport=LAPTOP)
        made.set_default_timeout(120_000)  # a record is identified, a display designed: a busy machine takes its time
        made.goto(f"http://127.0.0.1:{client.port}/#token={TOKEN}")
        made.wait_for_selector("body[data-ready=start]")
        made.evaluate(AXE)
        yield made
        made.close()


def faults(page, options):
    """Return the serious and critical faults that axe-core finds: rule and place of each."""
    found = page.evaluate("(more) => axe.run(document, { resultTypes: ['violations'], ...more })", options)
    return [
        (one["id"], node["target"], node["failureSummary"])
        for one in found["violations"]
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]


def opened(page, view):
    display = "display.toml" if view == "loop" else "displays/tactuator.toml"  # the first has tiles of every length
    go(page, view, display=f"example:{display}")
    page.wait_for_selector(SETTLED.get(view, "h1"))
    if view == "loop":  # a motor that rubs has one more
        page.evaluate("""async () => {
            const more = document.createElement("dl"), { tiles } = await import("/static/figures.js");
            tiles(more, [{ name: "level error, lowest level", value: "-1 dB", allowed: "±1 dB", outcome: "met" }]);
            document.querySelector(".tiles").append(...more.children); }""")
    if view in FILLED:
        page.locator("button.example").first.click()
        page.wait_for_selector(FILLED[view])


@pytest.mark.slow
@pytest.mark.parametrize(
    "looks",
    [LOOKS, pytest.param([(size, look, {}) for size in (LAPTOP, PHONE) for look in ("light", "dark")], marks=SOAK)],
)
def test_every_view__on_laptop_and_phone__has_no_serious_fault(page, looks):
    found = {"start": told} if (told := faults(page, {})) else {}
    for view in (one.name for one in VIEWS):
        opened(page, view)
        for size, scheme, options in looks:
            page.set_viewport_size(size)
            page.emulate_media(color_scheme=scheme)
            told = faults(page, options) + page.evaluate(CUT)
            if told:
                found[view, size["width"], scheme] = told
    assert (found, len(VIEWS)) == ({}, 9)
    page.emulate_media(color_scheme="light")
    page.evaluate("""() => {
        document.querySelector("main").insertAdjacentHTML("beforeend", "<button></button><img src='/static/icon.svg'>"
            + "<p id='faint'>faint</p><input>");
        document.querySelector("#faint").style.color = "#aaa"; // the page's own rules forbid styles in its text
    }""")
    assert {"button-name", "image-alt", "color-contrast", "label"} <= {rule for rule, *_ in faults(page, {})}
