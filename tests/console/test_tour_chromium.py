"""The tour of the start page, walked by keyboard: each file that a step saves is that of the step's own command."""

import filecmp
import os
import re
import shlex
from pathlib import Path

import pytest

from tactuator.cli.main import main
from tactuator.console.state import FILE, ConsoleState
from tests.console.pages import address_of, console_with, pressed, saved_by, tab_to, watched_page

START = Path(__file__).parents[2] / "src/tactuator/console/static/start.js"
TOUR = re.findall(r'^  \["[^"]+", (?:null|"(\w+)"), "([^"]+)"\],$', START.read_text("utf-8"), flags=re.MULTILINE)
SERVED = ("noise", "experiment")
"""Steps whose commands write no file: the scope is watched, and a study is served (test_study_chromium)."""


def commanded(lab):
    """Run the tour's commands in their order, and return the folder with what they wrote."""
    for view, line in TOUR:
        words = shlex.split(line.removesuffix(" && cd lab"))[1:]
        if words[0] not in SERVED:
            assert main(words) in (0, 1), line
            if "init --examples" in line:
                os.chdir(lab)
        assert view or words[0] in ("init", "calibrate")
    return lab


def step(page, words):
    """Go to the start page, and from there to the step of these words, by keyboard."""
    pressed(page, "#home", "body[data-ready=start]")
    page.locator(f".tour a:has-text('{words}')").press("Enter")


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
    made = sorted(path.name for path in mine.iterdir())
    assert made == sorted([*FILES, "reference.json"])
    different = [name for name in made if not filecmp.cmp(mine / name, lab / name, shallow=False)]
    assert different == []
    os.chdir(mine)
    assert main(["design", "mine.toml", "--out", "mine.json"]) == 0  # as it is, with no load to design for


FILES = ["controller.json", "felt.wav", "mine.toml", "model.json", "personal.json", "reference.wav", "response.csv"]


def walked(page, lab, mine):
    step(page, "Identify the actuator")
    chosen(page, "main input[type=file]", lab / "bench.csv")
    page.wait_for_selector("#tried")
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
    step(page, "Fit the prefilter")
    page.wait_for_selector("#error:has-text('Greatest error')")
    chosen(page, "main input[type=file]", lab / "curve.csv")
    page.wait_for_selector("#take")
    pressed(page, "#take", ".command:has-text('--curve curve.csv')")
    pressed(page, "#design", "a[download='personal.json']")
    saved_by(page, "a[download='personal.json']", mine / "personal.json")
    step(page, "Measure its response")
    page.wait_for_selector("#controller-file")
    page.set_input_files("#controller-file", mine / "controller.json")
    page.wait_for_selector("#measure:not([disabled])")
    pressed(page, "#measure", "#measured:has-text('points: measured')")
    saved_by(page, "#save-response", mine / "response.csv")
    step(page, "Render speech")
    chosen(page, "main input[type=file]", lab / "speech.wav")
    page.wait_for_selector("button.saving")
    for name in ("reference.wav", "reference.json", "felt.wav"):
        saved_by(page, f"[data-name='{name}']", mine / name)
