"""The console's server: who may ask, what is refused, and what the page is made of."""

import hashlib
import json
import re
from pathlib import Path

import pytest

from tactuator.console.app import build_console, static_file
from tactuator.console.state import ConsoleState
from tactuator.io.shipped import EXAMPLES
from tests.console.pages import TOKEN
from tests.web.server import served

ROOT = Path(__file__).resolve().parents[2]
STATIC = ROOT / "src" / "tactuator" / "console" / "static"
DRAW = {"do": "draw", "display": "example:display.toml", "channel": "index"}
SHAPE = {
    "gain_db": 16.0,
    "factors": [{"kind": "integrator"}, {"kind": "zero", "hz": 3.0}, {"kind": "pole", "hz": 200.0}],
}
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


def test_page__loads_nothing_from_elsewhere_and_is_small():
    texts = [part.read_text("utf-8") for part in STATIC.iterdir() if not part.name.startswith("uPlot")]
    assert [found for text in texts for found in re.findall(r"https?://\S+", text) if "w3.org" not in found] == []
    assert sum(part.stat().st_size for part in STATIC.iterdir()) < 500_000


def test_path__that_is_none__is_a_line_of_text(client):
    names = (f"{'9' * 5000}.css", "nothing.js", "%00.css", "..", "%2e%2e%2fapp.css", "%ff.css", "axe%2f..%2fapp.py")
    for path in (*(f"/static/{name}" for name in names), "/operator", "/ws"):
        answer = client.get(path)
        assert (answer.status, answer.text) == (404, "There is no such page here.\n")
    assert static_file("../app.py") is None


def test_draw__is_answered_and_its_figures_follow_but_those_of_an_unstable_loop(client):
    with client.websocket_connect("/ws") as socket:
        socket.send_text(TOKEN)
        for number, gain_db, unstable in ((7, 16.0, []), (8, 60.0, ["none", "finger"])):
            socket.send_json({"id": number, **DRAW, "shape": {**SHAPE, "gain_db": gain_db}})
            drawn, figures = socket.receive_json(), socket.receive_json()
            assert (drawn["id"], drawn["frame"]["unstable"], figures["of"]) == (number, unstable, number)
            if unstable:
                assert "unstable" in figures["figures"]["refused"]
            else:
                assert figures["figures"]["tiles"][0]["name"] == "phase margin"


def test_request__that_cannot_be_met__is_refused_in_words_and_the_next_is_answered(client):
    with client.websocket_connect("/ws") as socket:
        socket.send_text(TOKEN)
        for message, words in (
            ("no json", "allowed: a request of the console's page"),
            ("[]", "allowed: a request"),
            ("[" * 50_000, "allowed: a request"),
            ({"do": "format"}, "allowed: a request"),
            (DRAW, "shape"),
            ({**DRAW, "shape": {"gain_db": 1.0}}, "factors is None"),
            ({**DRAW, "channel": "toe", "shape": SHAPE}, "channel 'toe' is not described"),
            ({**DRAW, "display": "/etc/passwd", "shape": SHAPE}, "allowed: file"),
            ({**DRAW, "display": "example:displays/lra.toml", "channel": "index", "shape": SHAPE}, "allowed"),
            ({**POINT, "hz": -1}, "hz"),
            ({"do": "check", "display": "file", "shapes": {}}, "no loop yet"),
        ):
            socket.send_text(message if isinstance(message, str) else json.dumps({"id": 1, **message}))
            assert words in socket.receive_json()["error"]
            socket.send_json({"id": 2, "do": "start"})
            assert socket.receive_json()["named"] == "file"


def test_shipped_libraries__have_the_hashes_of_the_dependencies_page():
    page = (ROOT / "docs" / "dependencies.md").read_text("utf-8")
    parts = [*STATIC.glob("uPlot*"), *(Path(__file__).parent / "axe").iterdir()]
    assert len(parts) == 6
    for part in parts:
        assert f"{part.name}` | `{hashlib.sha256(part.read_bytes()).hexdigest()}`" in page, part.name


def test_terms__of_the_page__are_in_the_glossary():
    terms = re.findall(r'^  "([\w ]+)":', (STATIC / "words.js").read_text("utf-8"), flags=re.MULTILINE)
    glossary = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    assert len(terms) >= 8
    assert [term for term in terms if f"### {term}\n" not in glossary] == []
