"""The view Speech: the files that it makes are those of `render`, and what it shows is what `render` prints."""

import json
import shlex
import shutil

import pytest

from tactuator.cli.main import main
from tactuator.console.app import build_console
from tactuator.console.speech_view import SpeechRendered
from tactuator.console.state import FILE, ConsoleState
from tactuator.errors import BadInput
from tactuator.io.shipped import EXAMPLES
from tests.console.pages import ONE, TOKEN, dropped
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


def test_render__figures__are_lists_of_numbers_and_what_cannot_be_rendered_or_given_is_refused(rendered):
    _, state, answer = rendered
    finger = answer["fingers"][0]
    assert len(finger["hz"]) == sum(len(part["hz"]) for part in finger["parts"])
    assert all(len(row) == len(part["hz"]) for part in finger["parts"] for row in part["felt"])
    json.dumps(answer, allow_nan=False)
    speech, display = (dropped(state, EXAMPLES / name) for name in ("speech.wav", "display.toml"))
    for file, coding, words in (
        (display, "direct", "allowed"),
        (speech, "nothing", "is not known"),
        (speech, "../../secret.toml", "is not known"),
    ):
        with pytest.raises(BadInput, match=words):
            SpeechRendered(display=FILE, file=file, coding=coding).answer(state)
    with served(build_console(state, TOKEN)) as client:
        for key in (answer["key"], "0123"):
            assert client.get(f"/made/{key}/reference.wav").status == 403
