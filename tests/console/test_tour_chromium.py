"""The tour of the start page by keyboard: its files are those of its commands; and a study begun, run and ended."""

import filecmp
import os
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.console.state import FILE, ConsoleState
from tactuator.io.reference import open_reference
from tests.console.pages import address_of, console_with, opened_page, pressed, saved_by, tab_to, watched_page
from tests.console.test_accessibility_chromium import AXE, faults
from tests.experiment.session.apparatuses import PROTOCOL
from tests.web.study import ASKED, visible

START = Path(__file__).parents[2] / "src/tactuator/console/static/start.js"
TOUR = re.findall(r'^  \["[^"]+", (?:null|"(\w+)"), "([^"]+)"\],$', START.read_text("utf-8"), flags=re.MULTILINE)
SERVED = ("noise", "experiment")
"""Steps whose commands write no file: the scope is watched, and a study is served (test_study_chromium)."""


def commanded(lab):
    for view, line in TOUR:
        words = shlex.split(line.removesuffix(" && cd lab"))[1:]
        if words[0] not in SERVED:
            assert main(words) in (0, 1), line
            if "init --examples" in line:
                os.chdir(lab)
        assert view or words[0] in ("init", "calibrate")
    return lab


def step(page, words):
    pressed(page, "#home", "body[data-ready=start]")
    page.locator(f".tour a:has-text('{words}')").press("Enter")


def entered(page, selector, there):
    page.locator(selector).press("Enter")
    page.wait_for_selector(there)


def chosen(page, selector, path):
    """Choose a file where a person would choose it; the dialogue itself is none of the page's."""
    tab_to(page, selector)
    page.set_input_files(selector, path)


@pytest.mark.slow
def test_tour__walked_by_keyboard__gives_the_files_of_its_own_commands(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lab, mine = commanded(tmp_path / "lab"), tmp_path / "mine"
    mine.mkdir()
    state = ConsoleState(Path("display.toml"))
    rig = console_with(state, "simulated", state.display(FILE))
    with rig as client, watched_page(browser, 300.0, False) as page:
        page.goto(address_of(client))
        page.wait_for_selector("body[data-ready=start]")
        walked(page, lab, mine)
        assert client.host.status.wave is None
        played = client.host.samples.rows(0, client.host.samples.end)[:, 0]
    asked = np.concatenate([block[:, 0] for block in open_reference(mine / "reference.wav").blocks()])
    begin = int(np.flatnonzero(played)[-1]) - int(np.flatnonzero(asked)[-1])
    assert np.array_equal(played[begin : begin + asked.size], asked.astype(np.float32))
    made = sorted(path.name for path in mine.iterdir())
    assert made == sorted([*FILES, "reference.json"])
    different = [name for name in made if not filecmp.cmp(mine / name, lab / name, shallow=False)]
    assert different == []
    os.chdir(mine)
    assert main(["design", "mine.toml", "--out", "mine.json"]) == 0  # what a template decides is not judged


def measured(page, lab):
    """Measure, by the loops that were shaped, what a file plays live until then; stay through other views and slips."""
    entered(page, "#to-scope", "#live:not([disabled])")
    page.locator("#wave").select_option("file")
    page.set_input_files("#wave-file", lab / "reference.wav")
    page.wait_for_selector(".drop .name:has-text('reference.wav')")
    entered(page, "#live", "#rig-mode:has-text('live')")
    entered(page, "#play", "#wave-now:has-text('file at')")
    entered(page, "#to-response", "#needs:has-text('ends what plays live')")
    pressed(page, "#measure", "#measured:has-text('What played live was stopped.'):has-text('points: measured')")
    page.evaluate(AXE)
    assert faults(page, {}) == []
    for link, there in (("#to-loop", ".tiles[aria-busy=false]"), ("#to-response", "#measured:has-text(': measured')")):
        entered(page, link, there)
    assert page.locator(".measured .factor input:not([type])").input_value().startswith("1: free, 30 dB SL, loops of")
    page.locator("#level").fill("")
    page.locator("#frequencies").fill("one, 10")
    page.locator("#measure").click()
    assert page.locator(".wrong").all_inner_texts() == [
        "empty: enter -60 to 55",
        "“one” is no number above 0; expected frequencies in Hz, commas between",
    ]


FILES = ["controller.json", "felt.wav", "mine.toml", "model.json", "personal.json", "reference.wav", "response.csv"]


def walked(page, lab, mine):
    step(page, "Identify the actuator")
    chosen(page, "main input[type=file]", lab / "bench.csv")
    page.wait_for_selector("#tried")
    pressed(page, "#tried tbody tr:nth-child(2) button", ".command:has-text('--zeros')")
    entered(page, "button:has-text('Let the data choose')", ".command:not(:has-text('--zeros'))")
    saved_by(page, "a[download='model.json']", mine / "model.json")
    step(page, "Begin a display")
    chosen(page, "main input[type=file]", mine / "model.json")
    page.wait_for_selector("a[download='mine.toml']")
    saved_by(page, "a[download='mine.toml']", mine / "mine.toml")
    step(page, "Design the loop")
    page.wait_for_selector("#standing:has-text('not designed yet')")
    for finger in ("index", "thumb", "middle"):
        if finger != "index":
            tab_to(page, "#channel")
            page.keyboard.type(finger)
            page.wait_for_selector("#standing:has-text('not designed yet')")
        pressed(page, "button.first", "#standing:has-text('as designed')")
    pressed(page, "#check", "#save:focus")
    saved_by(page, "#save", mine / "controller.json")
    pressed(page, "#to-scope", "#levels small:has-text('nothing is played')")
    pressed(page, "#use-loops", "#loaded:has-text('loops of')")
    step(page, "Fit the prefilter")
    page.wait_for_selector("#error:has-text('Greatest error')")
    chosen(page, "main input[type=file]", lab / "curve.csv")
    page.wait_for_selector("#take")
    pressed(page, "#take", ".command:has-text('--curve curve.csv')")
    pressed(page, "#design", "a[download='personal.json']")
    saved_by(page, "a[download='personal.json']", mine / "personal.json")
    step(page, "Measure its response")
    measured(page, lab)
    saved_by(page, "#save-response", mine / "response.csv")
    step(page, "Render speech")
    chosen(page, "main input[type=file]", lab / "speech.wav")
    page.wait_for_selector("button.saving")
    for name in ("reference.wav", "reference.json", "felt.wav"):
        saved_by(page, f"[data-name='{name}']", mine / name)
    pressed(page, "#play-reference", "#playing:has-text('It plays')")
    page.wait_for_selector("#rig-mode:has-text('at rest')")


@pytest.mark.slow
def test_experiment__by_keyboard_alone__is_begun_run_exported_and_ended(browser, console, tmp_path):
    bad, good = tmp_path / "bad.toml", tmp_path / "short.toml"
    bad.write_text(PROTOCOL.replace("seed = 7", "sed = 7"))
    good.write_text(PROTOCOL.replace("[30, 90, 210]", "[30, 90]"))
    with opened_page(browser, f"{address_of(console)}&view=experiment", "experiment") as page:
        page.wait_for_selector("#needs:has-text('needs a controller, loaded above and a protocol')")
        page.set_input_files("#controller-file", console.file)
        page.wait_for_selector("#needs:has-text('needs a protocol')")
        tab_to(page, "#protocol")
        page.keyboard.press("ArrowDown")  # a study of the package
        page.wait_for_selector("#about-protocol:has-text('subjects S1')")
        assert page.locator("#needs").inner_text() == ""
        tab_to(page, "#protocol-file")
        page.set_input_files("#protocol-file", good)
        page.wait_for_selector("#about-protocol:has-text('detection, language en, subjects S1, S2. no curve: ')")
        page.set_input_files("#protocol-file", bad)
        page.wait_for_selector(".drop .alert:has-text('seed')")
        assert page.locator("#begin").is_disabled()
        page.set_input_files("#protocol-file", good)
        page.wait_for_selector("#about-protocol:has-text('“short”')")
        page.evaluate(AXE)
        assert faults(page, {}) == []
        pressed(page, "#begin", "#study:has-text('short')")
        pressed(page, "[data-start='S1']", "#state:has-text('running')")
        tab_to(page, "#sessions a")
        with page.context.expect_page() as opened:
            page.keyboard.press("Enter")
        for text in ("Before we begin", "Which interval has the vibration"):
            visible(opened.value, text)
            opened.value.keyboard.press("Enter")
        opened.value.wait_for_selector(ASKED)
        opened.value.keyboard.press("1")
        page.wait_for_selector("#track circle")
        assert faults(page, {}) == []
        tab_to(page, "#export")
        with page.expect_download() as download:
            page.keyboard.press("Enter")
        assert download.value.suggested_filename == "tidy.zip"
        page.wait_for_selector("#exported:has-text('1 trials')")
        page.keyboard.press("Escape")  # the stop that is always there
        page.wait_for_selector("#state:has-text('nobody')")
        pressed(page, "#end-study", "#begin:not([disabled])")
        assert page.locator("#rig-held").inner_text() == "this page has the controls"
