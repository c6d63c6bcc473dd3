"""Which names the server answers to, its encryption, its limits, and messages that nobody means."""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import ssl
import stat
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from http.client import HTTPConnection, HTTPSConnection
from pathlib import Path

import pytest
from fastapi import FastAPI, WebSocket, WebSocketDisconnect
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tactuator.errors import BadInput
from tactuator.experiment.store.store import Store
from tactuator.web import serve
from tactuator.web import server as serving
from tactuator.web.pages import plain_text
from tactuator.web.server import Address
from tactuator.web.sockets import refuse, send
from tactuator.web.study_pages import build_app
from tests.experiment.session.apparatuses import PROTOCOL
from tests.web.access.mutating import Asking, fuzz, hear_all
from tests.web.labs import TOKEN, begun, client, lab, make, make_lab, response_count, until  # noqa: F401
from tests.web.server import served

TLS = Path(__file__).parent / "tls"


def small() -> FastAPI:
    app = FastAPI()

    @app.get("/")
    async def index():
        return plain_text("here")

    @app.websocket("/refused")
    async def refused(socket: WebSocket) -> None:
        await socket.accept()
        await asyncio.sleep(0.02)
        await refuse(socket, 4003)

    @app.websocket("/ws")
    async def echo(socket: WebSocket) -> None:
        await socket.accept()
        with suppress(WebSocketDisconnect):
            await socket.send_text(await socket.receive_text())
            await socket.close()

    return app


@pytest.fixture(scope="module")
def port():
    with served(small()) as client:
        yield client.port


def status_of(port: int, host: str, path: str = "/", **headers: str) -> int:
    with closing(HTTPConnection("127.0.0.1", port, timeout=10.0)) as connection:
        connection.request("GET", path, headers={"Host": host, **headers})
        with connection.getresponse() as response:
            return response.status


UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version": "13",
}


def test_trusted_hosts__name_or_address__own_is_answered_and_anothers_refused(port: int) -> None:
    for host in ("localhost", "LOCALHOST:1", "127.0.0.1:8765", "192.168.1.7", "[::1]:9"):
        assert status_of(port, host) == 200, host
    for host in ("evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "[::1", ""):
        assert status_of(port, host) == 400, host
    assert status_of(port, "evil.example", "/ws", **UPGRADE) == 400


def test_websockets__refused_or_gone__leave_no_traceback_in_the_log(port: int, caplog, monkeypatch) -> None:
    hear_all(monkeypatch)
    lines = "".join(f"{name}: {value}\r\n" for name, value in {"Host": "localhost", **UPGRADE}.items())
    for path in ("/nothing", "/ws", "/refused") * 20:
        with socket.create_connection(("127.0.0.1", port), timeout=10.0) as made:
            made.sendall(f"GET {path} HTTP/1.1\r\n{lines}\r\n".encode())
    assert status_of(port, "localhost") == 200
    with connect(f"ws://127.0.0.1:{port}/ws") as last:
        last.send("the others are through")
        assert last.recv() == "the others are through"
    assert [record for record in caplog.records if record.exc_info] == []


def test_send__to_a_connection_that_the_server_has_ended__is_as_a_page_that_went() -> None:
    async def ended(message) -> None:  # as uvicorn's, once a flooded client answers no ping
        if message["type"] == "websocket.send":
            raise RuntimeError("Unexpected ASGI message 'websocket.send', after sending 'websocket.close'.")

    async def connected() -> dict[str, str]:
        return {"type": "websocket.connect"}

    async def sent() -> None:
        socket = WebSocket({"type": "websocket"}, connected, ended)
        await socket.accept()
        await send(socket, {"level": 1.0})

    with pytest.raises(WebSocketDisconnect):
        ThreadPoolExecutor(1).submit(asyncio.run, sent()).result()  # this thread may have a loop, a browser's


def test_address__certificate__encrypts_pages_and_answers_to_the_names_told() -> None:
    address = Address(names=("lab.example",), certificate=TLS / "certificate.pem", key=TLS / "key.pem")
    with closing(address.listen()) as sock:
        assert address.base_url(sock).startswith("https://127.0.0.1:")
    trusting = ssl.create_default_context(cafile=str(TLS / "certificate.pem"))
    with served(small(), address) as client:
        with closing(HTTPSConnection("127.0.0.1", client.port, context=trusting, timeout=10.0)) as connection:
            connection.request("GET", "/", headers={"Host": "lab.example"})
            with connection.getresponse() as response:
                assert response.status == 200
        with connect(f"wss://127.0.0.1:{client.port}/ws", ssl=trusting) as made:
            made.send("hello")
            assert made.recv() == "hello"
        with pytest.raises(OSError):
            status_of(client.port, "localhost")


def test_address__port_name_or_files_that_cannot_be__are_refused(run, tmp_path) -> None:
    with closing(Address().listen()) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(BadInput, match=f"port {port}"):
            Address(port=port).listen()
    for given, message in (
        ({"port": 65536}, "port 65536"),
        ({"names": ("a*",)}, "host name a"),
        ({"key": "key.pem"}, "a TLS key without a certificate"),
        ({"certificate": "certificate.pem"}, "no pair"),
        ({"certificate": "certificate.pem", "key": "other.pem"}, "no pair"),
        ({"certificate": "certificate.pem", "key": "locked.pem"}, "no pair without a password"),
        ({"certificate": "nothing.pem", "key": "key.pem"}, "No such file"),
    ):
        with pytest.raises(BadInput, match=message):
            Address(**{name: TLS / value if isinstance(value, str) else value for name, value in given.items()})
    (path := tmp_path / "protocol.toml").write_text(PROTOCOL)
    options = ("--tls-certificate", TLS / "certificate.pem", "--tls-key", TLS / "other.pem", "--port", "0")
    run.refused("experiment", "serve", path, "--store", tmp_path / "lab.db", *options, said="no pair")


def test_connections__beyond_the_limit__pages_refused_and_the_session_goes_on(lab, monkeypatch) -> None:
    monkeypatch.setattr(serving, "CONNECTIONS_MAX", 8)
    with served(build_app(lab, TOKEN)) as client, client.websocket_connect("/ws/subject/token-S1") as subject:
        assert begun(subject)["type"] == "answer-now"
        with ExitStack() as held:
            for _ in range(8):
                held.enter_context(socket.create_connection(("127.0.0.1", client.port), timeout=10.0))
            assert client.get("/").status == 503
            subject.send_json({"type": "pause"})
            assert until(subject, "stage")
        assert any(client.get("/").status == 200 for _ in range(100))  # once the server knows that they are gone


ODD = [
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",
    b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /s/" + b"a" * 15_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /s/%00%1b%5b2J%e2%80%ae HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: localhost\r\nX: \x1b[2J\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: [\r\n\r\n",
    b"POST / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
    b"GET /ws/operator HTTP/1.1\r\nHost: localhost\r\n%s%s\r\n"
    % ("".join(f"{name}: {value}\r\n" for name, value in UPGRADE.items()).encode(), b"X: y\r\n" * 200),
    b"POST /s/token-S1 HTTP/1.1\r\nHost: localhost\r\nOrigin: http://[\r\n\r\n",
    *(
        b"GET /ws/%s HTTP/1.1\r\nHost: localhost\r\n%sOrigin: %s\r\n\r\n"
        % (path, "".join(f"{name}: {value}\r\n" for name, value in UPGRADE.items()).encode(), origin)
        for path in (b"operator", b"subject/" + b"a" * 9000, b"subject/token-S1")
        for origin in (b"http://[", b"null", b"\xff\xfe", b"//", b"http://" + b"a" * 3000, b"http://localhost:99999999")
    ),
]


def test_requests__malformed_or_oversized__are_refused_quietly(client, caplog, monkeypatch, capfd) -> None:
    hear_all(monkeypatch)
    serving._log_visibly()
    for request in ODD:
        with socket.create_connection(("127.0.0.1", client.port), timeout=10.0) as made:
            made.sendall(request)
            assert made.recv(20) != b"HTTP/1.1 500", request
    for text in ("x" * 60_000, "\x00", "\u202e", ""):
        with client.websocket_connect("/ws/operator") as operator, pytest.raises(ConnectionClosed, match="4003"):
            operator.send_text(text)
            until(operator, "never")
    with (
        connect(f"ws://127.0.0.1:{client.port}/ws/operator") as operator,
        pytest.raises(ConnectionClosed, match="1007"),
    ):
        operator.send(b"\xff\xfe", text=True)
        while True:
            operator.recv(timeout=10.0)
    assert client.get("/").status == 200
    assert [record for record in caplog.records if "UTF-8" in record.getMessage()]  # the server has seen it
    quiet = [record for record in caplog.records if serving._tells_of_us(record)]
    assert quiet == []


def test_log__of_what_a_request_holds__shows_controls_and_marks_as_escapes() -> None:
    record = logging.LogRecord("uvicorn", logging.ERROR, "", 0, "\x1b[2J%s", ("\u202eexe",), None)
    assert serving._Visible("%(message)s").format(record) == "\\u001b[2J\\u202eexe"
    assert str(BadInput("two\nlines")) == "two\\nlines"


def test_message__longer_than_the_bound__ends_its_connection(client) -> None:
    with client.websocket_connect("/ws/subject/token-S1") as subject, pytest.raises(ConnectionClosed, match="1009"):
        subject.send_text("x" * (serving.MESSAGE_MAX_BYTES + 1))
        until(subject, "never")


def test_operator_token_and_store__are_not_guessed_nor_read_by_others(tmp_path, monkeypatch) -> None:
    file = tmp_path / "token"
    for content in ("", "\n", "short", "a token with spaces in it", "fünfzehn-und-mehr-zeichen"):
        file.write_text(content)
        monkeypatch.setenv(serve.TOKEN_VARIABLE, content)
        for given in (file, None):
            with pytest.raises(BadInput, match="16 or more"):
                serve._operator_token(given)
    file.write_text("0123456789abcdef\nsecond line\n")
    monkeypatch.delenv(serve.TOKEN_VARIABLE)
    assert serve._operator_token(file) == "0123456789abcdef"
    assert len(serve._operator_token(None)) >= 16
    monkeypatch.setenv(serve.TOKEN_VARIABLE, "fedcba9876543210")
    assert serve._operator_token(None) == "fedcba9876543210"
    with pytest.raises(BadInput, match="file not found"):
        serve._operator_token(tmp_path / "other")
    Store(tmp_path / "lab.db").close()
    assert stat.S_IMODE((tmp_path / "lab.db").stat().st_mode) == 0o600


FEW, MANY = 300, 100_000
SUBJECT = [
    {"type": "consent"},
    {"type": "ready", "stage": "trial"},
    {"type": "ready", "stage": "introduction"},
    {"type": "ready", "stage": "paused"},
    {"type": "ready", "stage": "break"},
    {"type": "pause"},
    {"type": "answer", "run": 1, "number": 0, "response": "1", "shown_ms": 10.0, "pressed_ms": 400.0, "lit_ms": [1, 2]},
]
OPERATOR = [
    {"type": "start", "session": 1},
    {"type": "pause"},
    {"type": "resume"},
    {"type": "give-up-run"},
    {"type": "clear-fault"},
    {"type": "take-control"},
    {"type": "results", "session": 1},
    {"type": "enrol", "code": "S1", "group": "hearing", "participant_id": "p", "demographics": {"age": "30"}},
    {"type": "new-visit", "subject": "S9"},
    {"type": "day", "session": 1, "skin_temperature_c": 31.0, "preload_n": 0.5},
    {"type": "correct", "subject": "S1", "reason": "slip", "group": "hearing", "demographics": {}},
]
PAGES = [("/ws/subject/token-S1", None, SUBJECT), ("/ws/operator", TOKEN, OPERATOR)]


@pytest.fixture
def goes_on(client):
    with client.websocket_connect("/ws/subject/token-S2") as other:
        until(other, "stage")

        def answered():
            assert client.get("/").status == 200
            other.send_json({"type": "nothing"})
            until(other, "refused")

        yield answered


def sent(client, page, count, told, goes_on):
    path, first, messages = page
    last = "the-last-of-these"
    return fuzz(lambda: Asking(client.port, path, first, {"type": last}, last), messages, count, told, goes_on)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
@pytest.mark.parametrize("page", PAGES, ids=["subject", "operator"])
def test_page__fuzzed_messages__keep_server_rig_and_other_sessions_going(
    client, lab, caplog, monkeypatch, goes_on, page, count
) -> None:
    heard = [json.loads(text) for text in sent(client, page, count, (caplog, monkeypatch), goes_on)]
    acknowledged = {(each["run"], each["number"]) for each in heard if each["type"] == "ack"}
    assert len(heard) > count // 4
    assert (lab.fault, response_count(lab) >= len(acknowledged)) == (None, True)
