"""Messages that nobody means, to every connection of a console: it answers each, logs no defect and stays usable."""

from __future__ import annotations

import json

import pytest

from tactuator.io.shipped import EXAMPLES
from tests.console.pages import TOKEN, dropped
from tests.web.access import requesting
from tests.web.access.mutating import Asking, defects, fails_once, fuzz

FEW, MANY = 200, 100_000
KEPT = 0.02
"""Share of unaltered messages that are sent: a design takes a second, and is no message that nobody means."""
DISPLAY = {"display": "example:display.toml"}
CHANNEL = {**DISPLAY, "channel": "index"}
SHAPE = {
    "gain_db": 16.0,
    "sign": 1,
    "factors": [{"kind": "integrator"}, {"kind": "zero", "hz": 3.0}, {"kind": "pole", "hz": 200.0}],
}
SET = {"text": "", "table": "channel", "place": 0, "key": "name"}
POINTS = [[10.0, 20.0], [100.0, 0.0], [400.0, 10.0]]


def requests_of(path: str, file: dict[str, str]) -> list[dict]:
    """Every request of a connection. file: keys of files that were dropped."""
    text = (EXAMPLES / "display.toml").read_text()
    of = {
        "/ws": [
            {"do": "start"},
            {"do": "open", **DISPLAY},
            {"do": "bring", **CHANNEL},
            {"do": "draw", **CHANNEL, "shape": SHAPE},
            {"do": "point", **CHANNEL, "shape": SHAPE, "hz": 30.0, "turn_deg": 5.0, "gain_db": 3.0},
            {"do": "design", **CHANNEL},
            {"do": "check", **DISPLAY, "shapes": {"index": SHAPE}},
            {"do": "display.read", "display": None, "file": file["display"]},
            {"do": "display.judge", "text": text, **DISPLAY},
            {"do": "display.set", "text": text, "table": "channel", "place": 0, "key": "name", "value": '"index"'},
            {"do": "experiment.start"},
            {"do": "experiment.look", "protocol": "example:protocol.toml"},
            {"do": "identify.look", "record": file["record"], "input": "drive", "output": "encoder", "rate_hz": None},
            {"do": "identify.model", "record": file["display"], "order": 2, "hold": "auto", "validate_on": []},
            {"do": "prefilter.curve", "file": file["curve"]},
            {"do": "prefilter.fit", **CHANNEL, "points": POINTS, "poles": 4},
            {"do": "prefilter.save", **DISPLAY, "points": POINTS, "file": None, "poles": 4},
            {"do": "speech.codings"},
            {"do": "speech.render", **DISPLAY, "file": file["curve"], "coding": "direct", "level": 30.0},
        ],
        "/ws/rig": [
            *({"do": name} for name in ("take", "give", "live", "stop", "rest", "reopen")),
            {"do": "controller", "source": "file", "file": file["controller"], "shapes": {}},
            {"do": "wave", "kind": "tone", "level_db_sl": 20.0, "channels": ["index"], "frequency_hz": 50.0},
            {"do": "wave", "kind": "sweep", "level_db_sl": 20.0, "channels": ["index"], "to_hz": 300.0, "sweep_s": 1.0},
            {"do": "wave", "kind": "file", "level_db_sl": 20.0, "channels": ["index"], "file": file["curve"]},
            {"do": "touch", "channel": "index", "load": "finger"},
            {"do": "press", "channel": "index", "force_v": 0.1},
            {"do": "measure", "channels": ["index"], "level_db_sl": 20.0, "load": "none", "frequency_hz": [50.0]},
            {"do": "expected", "level_db_sl": 20.0},
            {"do": "peaks", "file": file["curve"]},
            {"do": "look", "span_s": 0.1, "columns": 100, "mode": "auto", "channel": "index", "level": 0.0, "end": 0},
            {"do": "drawn", "frame": 1},
            {"do": "save", "channel": "index", "span_s": 0.01, "end": 100},
        ],
        "/ws/study": [
            {"do": "begin", "protocol": "example:protocol.toml", "store": "lab.db", "files": [], "amend": "because"},
            {"do": "end"},
            {"do": "export", "store": "lab.db", "form": "tidy"},
        ],
    }
    return [{"id": 1, **request} for request in of[path]]


@pytest.fixture(scope="module")
def files(console):
    """The keys of files that were dropped on the console."""
    names = {"record": "bench.csv", "curve": "curve.csv", "display": "display.toml"}
    made = {kind: dropped(console.state, EXAMPLES / name) for kind, name in names.items()}
    return made | {"controller": dropped(console.state, console.file)}


@pytest.fixture
def opened(console):
    """A function that opens a connection of the console."""
    return lambda path: Asking(console.port, path, TOKEN, {"id": 2**52, "do": "nothing"}, str(2**52))


@pytest.fixture
def goes_on(console, opened):
    """A call that finds a page given and another page answered."""
    other = opened("/ws")
    yield lambda: (other.settle(), console.get("/").status == 200 or pytest.fail("no page"))
    other.close()


def test_fuzz__defect_in_one_message_or_request_of_many__is_noticed(
    console, files, caplog, monkeypatch, opened, goes_on
) -> None:
    with monkeypatch.context() as patched:
        fails_once(patched, "tactuator.console.requests.checked", 70)
        with pytest.raises(AssertionError, match="a request of the console failed"):
            fuzz(lambda: opened("/ws/rig"), requests_of("/ws/rig", files), FEW, (caplog, patched), goes_on, KEPT)
    caplog.clear()
    fails_once(monkeypatch, "tactuator.console.app.static_file", 8)  # after warnings
    requests = requesting.heads(["/static/console.css"], TOKEN)
    with pytest.raises(AssertionError, match="Exception in ASGI"):
        requesting.fuzz(console.port, requests, FEW, caplog, monkeypatch, goes_on)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
@pytest.mark.parametrize("path", ["/ws", "/ws/rig", "/ws/study"])
def test_console__messages_nobody_means__logs_no_defect(
    files, caplog, monkeypatch, opened, goes_on, path, count
) -> None:
    heard = fuzz(lambda: opened(path), requests_of(path, files), count, (caplog, monkeypatch), goes_on, KEPT)
    assert len(heard) > count // 2


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
def test_console__requests_nobody_makes__logs_no_defect(console, files, caplog, monkeypatch, goes_on, count) -> None:
    paths = ["/", "/static/console.css", f"/made/{files['curve']}/curve.csv", "/ws", "/ws/rig", "/operator"]
    answered = requesting.fuzz(console.port, requesting.heads(paths, TOKEN), count, caplog, monkeypatch, goes_on)
    assert answered > count // 4


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("/ws/study", '{"id": "\\ud800", "do": "end"}'),
        ("/ws/study", '{"id": 1e400, "do": "end"}'),
        ("/ws", json.dumps({"id": 1, "do": "display.judge", "text": f"a = {'9' * 5000}"})),
        ("/ws", json.dumps({"id": 1, "do": "display.judge", "text": f"{'a.' * 20_000}a = 1"})),
        ("/ws", json.dumps({"id": 1, "do": "display.set", **SET, "value": "[" * 4000})),
    ],
)
def test_console__number_or_text_that_no_answer_can_bear__is_refused(opened, caplog, path, message) -> None:
    asking = opened(path)
    asking.socket.send(message)
    assert not [one for one in asking.settle() if "a defect of" in one]
    asking.close()
    assert defects(caplog) == []
