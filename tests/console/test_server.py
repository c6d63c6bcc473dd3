"""The console's server: who may ask, what is refused, what the page is made of, files that are no good, its end."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import json
import logging
import os
import re
import signal
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import uvicorn
from fastapi import FastAPI

from tactuator.console import page_server as console
from tactuator.console import serve
from tactuator.console.page_connection import REQUESTS as FUNCTIONS
from tactuator.console.page_server import build_console, static_file
from tactuator.console.requests import bound, requested
from tactuator.console.state import ConsoleState
from tactuator.errors import BadInput
from tactuator.io.shipped import EXAMPLES
from tactuator.web.server import Address
from tests.console.pages import TOKEN, dropped
from tests.web.access.mutating import Asking, defects, fails_once, fuzz
from tests.web.server import served
from tests.web.study import FORKS

ROOT = Path(__file__).resolve().parents[2]
STATIC = ROOT / "src" / "tactuator" / "console" / "static"
SHAPE = {
    "gain_db": 16.0,
    "sign": 1,
    "factors": [{"kind": "integrator"}, {"kind": "zero", "hz": 3.0}, {"kind": "pole", "hz": 200.0}],
}
DRAW = {"do": "draw", "display": "example:display.toml", "channel": "index"}
POINT = {**DRAW, "do": "point", "shape": SHAPE, "turn_deg": 0, "gain_db": 0}


@pytest.fixture(scope="module")
def client():
    with served(build_console(ConsoleState(EXAMPLES / "display.toml"), TOKEN)) as made:
        yield made


def test_page__and_its_parts__have_the_hardened_headers(client):
    for path in ["/", *(f"/static/{part.name}" for part in STATIC.iterdir() if part.suffix != ".html")]:
        answer = client.get(path)
        assert answer.status == 200, path
        assert answer.headers["Content-Security-Policy"].startswith("default-src 'self'")
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
    names = (f"{'9' * 5000}.css", "nothing.js", "%00.css", "..", "%2e%2e%2fapp.css", "%ff.css", "axe%2f..%2fapp.py")
    for path in (*(f"/static/{name}" for name in names), "/operator", "/ws"):
        answer = client.get(path)
        assert (answer.status, answer.text) == (404, "There is no such page here.\n")
    assert static_file("../app.py") is None


def test_page__loads_nothing_from_elsewhere__and_has_the_documents_libraries():
    texts = [part.read_text("utf-8") for part in STATIC.iterdir() if not part.name.startswith("uPlot")]
    assert [found for text in texts for found in re.findall(r"https?://\S+", text) if "w3.org" not in found] == []
    assert sum(part.stat().st_size for part in STATIC.iterdir()) < 500_000
    page = (ROOT / "docs" / "dependencies.md").read_text("utf-8")
    parts = [*STATIC.glob("uPlot*"), *(Path(__file__).parent / "axe").iterdir()]
    assert len(parts) == 6
    for part in parts:
        assert f"{part.name}` | `{hashlib.sha256(part.read_bytes()).hexdigest()}`" in page, part.name
    terms = re.findall(r'^  "([\w ]+)":', (STATIC / "words.js").read_text("utf-8"), flags=re.MULTILINE)
    glossary = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    assert len(terms) >= 8
    assert [term for term in terms if f"### {term}\n" not in glossary] == []


def test_draw__is_answered_and_its_figures_follow_but_those_of_an_unstable_loop(client):
    with client.websocket_connect("/ws") as socket:
        socket.send_text(TOKEN)
        for number, gain_db, unstable in ((7, 16.0, []), (8, 60.0, ["none", "finger"])):
            socket.send_json({"id": number, **DRAW, "shape": {**SHAPE, "gain_db": gain_db}})
            drawn, figures = socket.receive_json(), socket.receive_json()
            assert (drawn["id"], drawn["frame"]["unstable"], figures["of"]) == (number, unstable, drawn["drawing"])
            if unstable:
                assert "unstable" in figures["figures"]["refused"]
            else:
                assert figures["figures"]["tiles"][0]["name"] == "phase margin"


def test_request__that_cannot_be_met__is_refused_in_words_and_the_next_is_answered(client):
    with client.websocket_connect("/ws") as socket:
        socket.send_text(TOKEN)
        for message, words in (
            ("no json", "a request of the console's page"),
            ("[" * 50_000, "a request"),
            ({"do": "format"}, "a request"),
            (DRAW, "shape"),
            ({**DRAW, "display": "/etc/passwd", "shape": SHAPE}, "file"),
            ({**DRAW, "display": "example:displays/lra.toml", "channel": "index", "shape": SHAPE}, "; "),
            ({**POINT, "hz": -1}, "hz"),
            ({"do": "check", "display": "file", "shapes": {}}, "no loop yet"),
        ):
            socket.send_text(message if isinstance(message, str) else json.dumps({"id": 1, **message}))
            assert words in socket.receive_json()["error"]
            socket.send_json({"id": 2, "do": "start"})
            assert socket.receive_json()["named"] == "file"


NOISE = np.random.default_rng(1).bytes(5000)
FILES = {
    "empty.csv": b"",
    **{f"random.{ending}": NOISE for ending in ("csv", "h5", "mat", "wav", "toml")},
    "brackets.toml": b"[" * 50_000,
    "no ending": NOISE,
    "odd näme ☃.csv": b"time_s,command_v,position_v\n0,1,2\n1,x,2\n2,nan,inf\n",
}
"""What each reader refuses stands in tests/io; here is whether a view tells it."""
REQUESTS = {
    "identify": {"do": "identify.model", "record": None},
    "display": {"do": "display.read", "file": None},
    "prefilter": {"do": "prefilter.curve", "file": None},
    "speech": {"do": "speech.render", "display": "example:display.toml", "file": None},
    "experiment": {"do": "experiment.look", "protocol": None},
}


@pytest.fixture(scope="module")
def state():
    return ConsoleState()


@pytest.mark.parametrize("view", REQUESTS)
def test_file_that_is_no_good__dropped_on_a_view__is_refused_in_one_line(state, tmp_path, view):
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
        key = dropped(state, tmp_path / name)
        functions = bound(FUNCTIONS, state)
        request = requested(functions, {"id": 1, **{k: v or key for k, v in REQUESTS[view].items()}})
        answer, said = {}, ""
        try:
            with state.uploads.named_plainly():
                answer = request()
        except BadInput as refusal:
            said = str(refusal)
        assert ("\n" in said, str(state.uploads.folder()) in said) == (False, False), name
        if not said:  # a display that can be read is shown as it is, and its fault told
            assert view == "display", name
            assert functions["display.judge"](text=answer["text"][:60_000])["fault"], name


def test_dropped_file__of_any_name_or_on_a_full_disk__stays_in_its_folder(monkeypatch):
    async def blocks():
        yield b"1,2\n"

    for name in ("", ".hidden", "a" * 200 + ".csv", "new\nline.csv", "../../up.csv", "c:\\x\\y.csv"):
        state = ConsoleState()
        with pytest.raises((BadInput, StopIteration)) as ended:  # a coroutine returns by the latter
            state.uploads.take(name, blocks()).send(None)
        if isinstance(ended.value, StopIteration):
            path = state.uploads.path(ended.value.value)
            assert (path.is_relative_to(state.uploads.folder()), path.name in ("up.csv", "y.csv")) == (True, True)
        else:
            assert "; " in str(ended.value)

    async def blocks():
        raise OSError(errno.ENOSPC, "No space left on device")
        yield b""

    state = ConsoleState()
    with pytest.raises(BadInput, match=r"a.csv cannot be kept: No space left on device; "):
        state.uploads.take("a.csv", blocks()).send(None)
    assert not list(state.uploads.folder().iterdir())


def comes_to_be(is_so: Callable[[], bool]) -> bool:
    end = time.monotonic() + 30.0
    while not is_so() and time.monotonic() < end:
        time.sleep(0.02)
    return is_so()


def test_drop__whose_sender_goes_before_its_end__leaves_nothing_and_logs_nothing(state, monkeypatch, caplog):
    head = (
        f"POST /drop HTTP/1.1\r\nHost: localhost\r\nX-Token: {TOKEN}\r\nX-Name: a.csv\r\nContent-Length: 9\r\n\r\na,b"
    )
    with served(build_console(state, TOKEN)) as client:
        monkeypatch.setattr(logging.getLogger("uvicorn"), "propagate", True)
        before = len(list(state.uploads.folder().iterdir()))
        with socket.create_connection(("127.0.0.1", client.port)) as stranger:
            stranger.sendall(head.replace(TOKEN, "another").encode())
            assert stranger.recv(99).startswith(b"HTTP/1.1 403 ")
        with socket.create_connection(("127.0.0.1", client.port)) as one:
            one.sendall(head.encode())
            assert comes_to_be(lambda: len(list(state.uploads.folder().iterdir())) == before + 1)
        assert comes_to_be(lambda: len(list(state.uploads.folder().iterdir())) == before)
        assert client.get("/").status == 200
    assert defects(caplog) == []


def serving(said):
    """A process of its own: a server that is asked for what takes minutes; what it complains of is heard as well."""
    os.dup2(said.fileno(), 1)
    os.dup2(said.fileno(), 2)
    sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
    console.PATIENCE_S = 0.3
    app, sock = FastAPI(), Address().listen()

    def say(text):
        os.write(1, f"{text}\n".encode())

    @app.get("/")
    async def long():
        say("computing")
        await asyncio.to_thread(time.sleep, 300)

    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(143))  # as the command line does
    signal.signal(signal.SIGINT, signal.default_int_handler)
    config = uvicorn.Config(app, log_level="warning")
    server = console.ConsoleServer(config, lambda: say("at rest"), lambda: say("forgotten"))
    say(sock.getsockname()[1])
    server.run(sockets=[sock])


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_server__told_to_end_while_it_computes__closes_the_rig_and_ends(number, status):
    hears, said = FORKS.Pipe(duplex=False)
    process = FORKS.Process(target=serving, args=(said,), daemon=True)
    process.start()
    said.close()
    try:
        with open(hears.fileno(), closefd=False) as lines:
            with socket.create_connection(("127.0.0.1", int(lines.readline()))) as asking:
                asking.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
                assert lines.readline() == "computing\n"
                os.kill(process.pid, number)
                process.join(60.0)
            assert lines.read().splitlines() == ["at rest", "forgotten"]
    finally:
        process.kill()
        hears.close()
    assert process.exitcode == status


@pytest.mark.parametrize("asked", [True, False])
def test_console__asked_to_open_its_page__opens_the_address_that_it_prints(monkeypatch, asked):
    opened, said = [], []
    monkeypatch.setattr(serve.webbrowser, "open", opened.append)
    monkeypatch.setattr(
        serve, "run_server", lambda app, address, listening, lines, make: said.extend(lines("http://here"))
    )
    serve.console(port=0, open_browser=asked)
    assert said == [f"console: {page}" for page in opened] if asked else not opened


FEW, MANY = 200, 100_000
KEPT = 0.02
"""Share of unaltered messages that are sent: a design takes a second, and is no message that nobody means."""
DISPLAY = {"display": "example:display.toml"}
CHANNEL = {**DISPLAY, "channel": "index"}
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
            *({"do": name} for name in ("take", "give", "live", "microphones", "stop", "reopen")),
            {"do": "listen", "settings": {"coding": "direct", "level_db_sl": 20.0, "file": file["curve"]}},
            {"do": "mute", "muted": True},
            {"do": "controller", "source": "file", "file": file["controller"], "shapes": {}},
            {"do": "wave", "wave": {"kind": "tone", "level_db_sl": 20.0, "channels": ["index"], "frequency_hz": 50.0}},
            {
                "do": "wave",
                "wave": {"kind": "sweep", "level_db_sl": 20.0, "channels": ["index"], "to_hz": 300.0, "sweep_s": 1.0},
            },
            {"do": "wave", "wave": {"kind": "file", "level_db_sl": 20.0, "channels": ["index"], "file": file["curve"]}},
            {"do": "touch", "channel": "index", "load": "finger"},
            {"do": "press", "channel": "index", "force_v": 0.1},
            {
                "do": "measure",
                "settings": {"channels": ["index"], "level_db_sl": 20.0, "load": "none", "frequency_hz": [50.0]},
            },
            {"do": "expected", "level_db_sl": 20.0},
            {"do": "peaks", "file": file["curve"]},
            {
                "do": "look",
                "look": {"span_s": 0.1, "columns": 100, "mode": "auto", "channel": "index", "level": 0.0, "end": 0},
            },
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
    names = {"record": "bench.csv", "curve": "curve.csv", "display": "display.toml"}
    made = {kind: dropped(console.state, EXAMPLES / name) for kind, name in names.items()}
    return made | {"controller": dropped(console.state, console.file)}


@pytest.fixture
def opened(console):
    return lambda path: Asking(console.port, path, TOKEN, {"id": 2**52, "do": "nothing"}, str(2**52))


@pytest.fixture
def goes_on(console, opened):
    other = opened("/ws")
    yield lambda: (other.settle(), console.get("/").status == 200 or pytest.fail("no page"))
    other.close()


def test_fuzz__defect_in_one_message_of_many__is_noticed(files, caplog, monkeypatch, opened, goes_on) -> None:
    fails_once(monkeypatch, "tactuator.console.requests.requested", 70)
    with pytest.raises(AssertionError, match="a request of the console failed"):
        fuzz(lambda: opened("/ws/rig"), requests_of("/ws/rig", files), FEW, (caplog, monkeypatch), goes_on, KEPT)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
@pytest.mark.parametrize("path", ["/ws", "/ws/rig", "/ws/study"])
def test_console__fuzzed_messages__logs_no_defect(files, caplog, monkeypatch, opened, goes_on, path, count):
    heard = fuzz(lambda: opened(path), requests_of(path, files), count, (caplog, monkeypatch), goes_on, KEPT)
    assert len(heard) > count // 2


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
