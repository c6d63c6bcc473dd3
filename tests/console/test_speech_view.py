"""The view Speech: the files that it makes are those of `render`, and what it shows is what `render` prints."""

import json
import shlex
import shutil
from contextlib import closing

import numpy as np
import pytest

from tactuator.cli.main import main
from tactuator.console.app import build_console
from tactuator.console.rig_process import RigProcess
from tactuator.console.speech_view import SpeechRendered
from tactuator.console.state import FILE, ConsoleState
from tactuator.errors import BadInput
from tactuator.io.reference import open_reference
from tactuator.io.shipped import EXAMPLES
from tests.console.pages import ONE, TOKEN, console_page, dropped, go, saved_by, tab_to
from tests.web.server import served


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("speech")
    (folder / "display.toml").write_text(ONE)
    shutil.copy(EXAMPLES / "speech.wav", folder / "speech.wav")
    state = ConsoleState(folder / "display.toml")
    key = dropped(state, EXAMPLES / "speech.wav")
    found = SpeechRendered(display=FILE, file=key, level=30.0).answer(state)
    return folder, state, found


def test_render__of_a_speech_file__makes_the_files_of_the_shown_command(rendered, monkeypatch, capsys):
    folder, state, found = rendered
    monkeypatch.chdir(folder)
    main([*shlex.split(found["command"])[1:], "--json"])
    made = state.uploads.path(found["key"]).parent
    for name in found["files"]:
        assert (folder / name).read_bytes() == (made / name).read_bytes(), name
    felt = json.loads(capsys.readouterr().out)["felt"]["index"]
    assert found["rows"][0][3:] == [f"{felt[name]:.2f}" for name in ("rms_db", "median_db_all", "p95_db_all")]


def test_render__figures_of_the_page__are_lists_of_numbers(rendered):
    finger = rendered[2]["fingers"][0]
    assert len(finger["hz"]) == sum(len(part["hz"]) for part in finger["parts"])
    assert all(len(row) == len(part["hz"]) for part in finger["parts"] for row in part["felt"])
    json.dumps(rendered[2], allow_nan=False)


def test_render__of_what_is_no_sound__says_so(rendered):
    _, state, _ = rendered
    key = dropped(state, EXAMPLES / "display.toml")
    with pytest.raises(BadInput, match="allowed"):
        SpeechRendered(display=FILE, file=key).answer(state)


@pytest.mark.parametrize("coding", ["nothing", "../../secret.toml"])
def test_render__with_a_coding_that_is_none__is_refused(rendered, coding):
    _, state, _ = rendered
    key = dropped(state, EXAMPLES / "speech.wav")
    with pytest.raises(BadInput, match="is not known"):
        SpeechRendered(display=FILE, file=key, coding=coding).answer(state)


def test_made__without_the_token_or_under_another_name__is_not_given(rendered):
    _, state, found = rendered
    with served(build_console(state, TOKEN)) as client:
        assert client.get(f"/made/{found['key']}/reference.wav").status == 403
        assert client.get("/made/0123/reference.wav").status == 403


@pytest.mark.slow
def test_speech__by_keyboard_alone__is_rendered_saved_and_played_on_the_rig(browser, rendered, tmp_path):
    folder, state, found = rendered
    with (
        closing(RigProcess("simulated", state.display(FILE))) as host,
        console_page(browser, folder / "display.toml", host) as page,
    ):
        go(page, "speech", display=FILE, level="30")
        tab_to(page, "input[type=file]")
        page.locator("input[type=file]").set_input_files(EXAMPLES / "speech.wav")
        page.wait_for_selector("button.saving")
        tab_to(page, "[data-name='reference.wav']")
        saved_by(page, "[data-name='reference.wav']", tmp_path / "reference.wav")
        page.locator("#play-reference").focus()
        page.keyboard.press("Enter")
        page.wait_for_selector("#playing:has-text('It plays')")
        page.wait_for_selector("#rig-mode:has-text('at rest')")
        played = host.samples.rows(0, host.samples.end)[:, 0]
    kept = state.uploads.path(found["key"])
    assert (tmp_path / "reference.wav").read_bytes() == kept.read_bytes()
    asked = np.concatenate([block[:, 0] for block in open_reference(kept).blocks()]).astype(np.float32)
    begin = int(np.flatnonzero(played)[0]) - int(np.flatnonzero(asked)[0])
    assert np.array_equal(played[begin : begin + asked.size], asked)
