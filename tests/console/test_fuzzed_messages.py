"""Messages that nobody means, to every connection of a console: it answers each, logs no defect and stays usable."""

from __future__ import annotations

import json
from contextlib import ExitStack, closing, suppress
from http.client import HTTPConnection

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tactuator.io.shipped import EXAMPLES
from tests.console.pages import TOKEN, dropped
from tests.web.access import requesting
from tests.web.access.mutating import defects, fails_once, hear_all, mutated

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


def of_page(file: dict[str, str]) -> list[dict]:
    """Every request of the page's own connection. file: keys of files that were dropped."""
    text = (EXAMPLES / "display.toml").read_text()
    return [
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
    ]


def of_rig(file: dict[str, str]) -> list[dict]:
    """Every request of the rig's connection."""
    return [
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
    ]


def of_study(file: dict[str, str]) -> list[dict]:
    """Every request of the study's connection."""
    del file
    return [
        {"do": "begin", "protocol": "example:protocol.toml", "store": "lab.db", "files": [], "amend": "because"},
        {"do": "end"},
        {"do": "export", "store": "lab.db", "form": "tidy"},
    ]


class Asking:
    """One connection whose answers are read; `number` of the last message that was answered."""

    def __init__(self, port: int, path: str) -> None:
        self._open = ExitStack()
        self.socket = self._open.enter_context(connect(f"ws://127.0.0.1:{port}{path}"))
        self.socket.send(TOKEN)

    def settle(self) -> list[str]:
        """Send what is no request and read on until its answer has come; what was answered before, as text."""
        self.socket.send(json.dumps({"id": 2**52, "do": "nothing"}))
        heard = []
        while True:
            text = self.socket.recv(timeout=60.0)
            if isinstance(text, str):
                heard.append(text)
                if json.loads(text, parse_constant=_no_number).get("id") == 2**52:
                    return heard

    def close(self) -> None:
        self._open.close()


def _no_number(name: str) -> None:
    raise AssertionError(f"{name} was sent, which no page can read")


def sent(rng: np.random.Generator, messages: list[dict]) -> str | bytes:
    while True:
        message = {"id": int(rng.integers(2**20)), **messages[int(rng.integers(len(messages)))]}
        made = mutated(rng, message)
        if made != json.dumps(message) or rng.random() < KEPT:
            return made


def fuzz(client, caplog, monkeypatch, path: str, messages: list[dict], count: int, seed: int = 21) -> None:
    """Send so many mutated messages; fails where the console logs a defect, or another page is not answered."""
    hear_all(monkeypatch)
    rng, heard, other = np.random.default_rng(seed), 0, Asking(client.port, "/ws")
    asking, last = Asking(client.port, path), ""
    for index in range(count):
        text = sent(rng, messages)
        try:
            asking.socket.send(text)
            if index % 20 == 19:
                answers = asking.settle()
                heard += len(answers)
                assert not [one for one in answers if "a defect of" in one], last
        except ConnectionClosed:
            asking.close()
            asking = Asking(client.port, path)
        if index % 500 == 499:
            assert other.settle()
            assert client.get("/").status == 200
    for one in (asking, other):
        with suppress(ConnectionClosed):
            one.close()
    assert heard > count // 2
    assert defects(caplog) == []


@pytest.fixture(scope="module")
def files(console):
    """The keys of files that were dropped on the console."""
    names = {"record": "bench.csv", "curve": "curve.csv", "display": "display.toml"}
    made = {kind: dropped(console.state, EXAMPLES / name) for kind, name in names.items()}
    return made | {"controller": dropped(console.state, console.file)}


@pytest.mark.parametrize(("path", "messages"), [("/ws", of_page), ("/ws/rig", of_rig), ("/ws/study", of_study)])
def test_fuzz__defect_in_one_message_of_many__is_noticed(console, files, caplog, monkeypatch, path, messages) -> None:
    fails_once(monkeypatch, "tactuator.console.requests.checked", 70)
    with pytest.raises(AssertionError, match="a defect of"):
        fuzz(console, caplog, monkeypatch, path, messages(files), FEW)


def test_fuzz__defect_in_one_request_of_many__is_noticed(console, caplog, monkeypatch) -> None:
    fails_once(monkeypatch, "tactuator.console.app.static_file", 8)  # after warnings
    requests, other = requesting.heads(["/static/console.css"], TOKEN), Asking(console.port, "/ws")
    with pytest.raises(AssertionError, match="Exception in ASGI"):
        requesting.fuzz(console.port, requests, FEW, caplog, monkeypatch, lambda: assert_answered(other))
    other.close()


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
@pytest.mark.parametrize(("path", "messages"), [("/ws", of_page), ("/ws/rig", of_rig), ("/ws/study", of_study)])
def test_console__messages_nobody_means__logs_no_defect(
    console, files, caplog, monkeypatch, path, messages, count
) -> None:
    fuzz(console, caplog, monkeypatch, path, messages(files), count)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
def test_console__requests_nobody_makes__logs_no_defect(console, files, caplog, monkeypatch, count) -> None:
    paths = ["/", "/static/console.css", f"/made/{files['curve']}/curve.csv", "/ws", "/ws/rig", "/operator"]
    requests = requesting.heads(paths, TOKEN)
    other = Asking(console.port, "/ws")
    answered = requesting.fuzz(console.port, requests, count, caplog, monkeypatch, lambda: assert_answered(other))
    assert answered > count // 4
    other.close()


def assert_answered(other: Asking) -> None:
    assert other.settle()


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
def test_console__number_or_text_that_no_answer_can_bear__is_refused(console, caplog, path, message) -> None:
    asking = Asking(console.port, path)
    asking.socket.send(message)
    assert not [one for one in asking.settle() if "a defect of" in one]
    asking.close()
    assert defects(caplog) == []


@pytest.mark.parametrize(
    "name", [f"{'9' * 5000}.css", "%00.css", "..", "%2e%2e%2fapp.css", "%ff.css", "axe%2f..%2fapp.py"]
)
@pytest.mark.parametrize("folder", ["static", "made"])
def test_console__name_that_no_file_has__is_not_found(console, files, caplog, monkeypatch, folder, name) -> None:
    hear_all(monkeypatch)
    path = f"/static/{name}" if folder == "static" else f"/made/{files['curve']}/{name}"
    asked = HTTPConnection("127.0.0.1", console.port, timeout=10.0)
    with closing(asked):
        asked.request("GET", path, headers={"X-Token": TOKEN})
        assert asked.getresponse().status == 404
    assert defects(caplog) == []
