"""Somebody with the page alone, by keyboard: trials of a study, speech played on the rig, Measure while live."""

import sqlite3

import numpy as np
import pytest
import soundfile

from tactuator.console.state import FILE, ConsoleState
from tactuator.io.shipped import EXAMPLES
from tests.console.pages import ONE, address_of, console_with, pressed, tab_to, watched_page
from tests.web.study import ASKED


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A console begun in a folder with a display, its rig simulated: the client, and its rig."""
    folder = tmp_path_factory.mktemp("newcomer")
    (folder / "display.toml").write_text(ONE)
    state = ConsoleState(folder / "display.toml", folder=folder)
    with console_with(state, "simulated", state.display(FILE)) as client:
        yield client


@pytest.fixture
def page(bench, browser):
    """The start page, to which the way is the address that the command prints."""
    with watched_page(browser, 180.0, also_logged=False) as page:
        page.goto(address_of(bench))
        page.wait_for_selector("body[data-ready=start]")
        yield page


def loaded(page):
    """Load a controller where the page says that it wants one."""
    page.wait_for_selector("#loaded")
    if page.locator("#loaded").inner_text() == "none yet":
        assert "needs a controller, loaded above" in page.locator("#needs").inner_text()
        pressed(page, "#use-design", "#loaded:not(:has-text('none'))")


def answered(page, trials):
    """Do what the subject's page says, by its keys, until so many trials are answered."""
    done = set()
    while len(done) < trials:
        page.wait_for_selector(f"#go:visible, {ASKED}")
        if page.locator("#go").is_visible():
            page.keyboard.press("Enter")
        else:
            page.keyboard.press("1")
            done.add(page.locator("body").get_attribute("data-trial"))
        page.wait_for_timeout(100)


@pytest.mark.slow
@pytest.mark.parametrize("trials", [4, pytest.param(10, marks=pytest.mark.soak)])
def test_newcomer__study_of_the_package__trials_by_keyboard(bench, page, trials):
    pressed(page, "#to-experiment", "body[data-ready=experiment]")
    assert page.locator("#needs").inner_text() == "needs a controller, loaded above and a protocol"
    loaded(page)
    assert page.locator("#needs").inner_text() == "needs a protocol"
    tab_to(page, "#protocol")
    page.keyboard.press("ArrowDown")
    page.wait_for_selector("#about-protocol:has-text('subjects S1')")
    assert page.locator("#needs").inner_text() == ""
    pressed(page, "#begin", "[data-start='S1']")
    assert page.get_by_role("button", name="Stop", exact=True).count() == 1
    pressed(page, "[data-start='S1']", "#state:has-text('running')")
    tab_to(page, "#sessions a")
    with page.context.expect_page() as opened:
        page.keyboard.press("Enter")
    subject = opened.value
    subject.set_default_timeout(60_000.0)
    answered(subject, trials)
    page.wait_for_selector("#export")
    page.wait_for_function(
        "least => Number(document.querySelector('#sessions td:nth-child(7)').textContent) >= least", arg=trials - 1
    )
    page.keyboard.press("Escape")
    page.wait_for_selector("#state:has-text('nobody')")
    pressed(page, "#end-study", "#begin:not([disabled])")
    with sqlite3.connect(next(bench.folder.glob("*.db"))) as store:
        (count,) = store.execute("SELECT count(*) FROM response").fetchone()
    assert count >= trials - 1  # the last answer may still have been on its way


@pytest.mark.slow
def test_newcomer__speech_and_then_measure_while_live__are_played_stopped_and_told(bench, page):
    pressed(page, "main .cards a[href*='display=file']", "body[data-ready=loop]")
    pressed(page, "#to-speech", "body[data-ready=speech]")
    tab_to(page, "main input[type=file]")
    samples, rate_hz = soundfile.read(EXAMPLES / "speech.wav")
    long = bench.folder / "speech.wav"  # it still plays when a busy machine shows the scope
    soundfile.write(long, np.tile(samples, 4), rate_hz)
    page.set_input_files("main input[type=file]", long)
    pressed(page, "#play-reference", "#playing:has-text('It plays.')")
    pressed(page, "#to-scope", "#wave-now:has-text('file at')")
    page.wait_for_selector("#rig-mode:has-text('at rest')")
    page.wait_for_selector("#levels small:has-text('nothing is played')")
    loaded(page)
    pressed(page, "#live", "#rig-mode:has-text('live')")
    pressed(page, "#play", "#wave-now:has-text('tone at')")
    pressed(page, "#to-response", "body[data-ready=response]")
    assert page.locator("#needs").inner_text() == "ends what plays live"
    tab_to(page, "#frequencies")
    page.keyboard.type("40,100")
    pressed(page, "#measure", "#measured:has-text('What played live was stopped. 2 points: measured')")
    assert bench.host.status.wave is None
    assert page.locator("#rig-mode").inner_text() == "at rest"
