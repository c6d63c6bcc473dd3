"""Which names the server answers to, what its refusals bear, its encryption, and its limits."""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import ssl
import stat
import threading
import time
from contextlib import closing, suppress
from http.client import HTTPConnection, HTTPSConnection
from pathlib import Path

import pytest
import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect
from websockets.sync.client import connect

from tactuator.errors import BadInput
from tactuator.experiment.store.store import Store
from tactuator.web import serve
from tactuator.web import server as serving
from tactuator.web.pages import HEADERS, plain_text
from tactuator.web.server import Address
from tests.experiment.session.apparatuses import PROTOCOL
from tests.web.access import requesting
from tests.web.access.mutating import Asking, defects, fuzz, hear_all
from tests.web.labs import TOKEN, begun, client, lab, make, make_lab, response_count, until  # noqa: F401  # noqa: F401
from tests.web.server import served

TLS = Path(__file__).parent / "tls"


def small() -> FastAPI:
    app = FastAPI()

    @app.get("/")
    async def index():
        return plain_text("here")

    @app.get("/broken")
    async def broken():
        raise ArithmeticError

    @app.exception_handler(Exception)
    async def failed(request, error):
        return plain_text("failed", 500)

    @app.websocket("/closed")
    async def closed(socket: WebSocket) -> None:
        await socket.accept()
        await asyncio.sleep(0.02)
        await socket.close(4003)

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


def asked(port: int, host: str, path: str = "/") -> tuple[int, dict[str, str]]:
    with closing(HTTPConnection("127.0.0.1", port, timeout=10.0)) as connection:
        connection.putrequest("GET", path, skip_host=True)
        connection.putheader("Host", host)
        connection.endheaders()
        with connection.getresponse() as response:
            return response.status, {name.lower(): value for name, value in response.getheaders()}


def bears_headers(found: dict[str, str]) -> bool:
    return {name.lower(): value for name, value in HEADERS.items()}.items() <= found.items()


def test_gate__by_name_or_address__answers_for_this_machine_and_refuses_somebody_elses_with_the_headers(port) -> None:
    for host in ("localhost", "LOCALHOST:1", "127.0.0.1:8765", "192.168.1.7", "[::1]:9"):
        assert asked(port, host)[0] == 200, host
    foreign = ("evil.example", "localhost.evil.example", "127.0.0.1.evil.example", "[::1", "", "a@b")
    for host, path, status in (*((host, "/", 421) for host in foreign), ("localhost", "/broken", 500)):
        answered, headers = asked(port, host, path)
        assert (answered, bears_headers(headers)) == (status, True), host


def test_gate__websocket_under_another_name_of_nothing_or_amiss__is_refused_with_the_headers(port: int) -> None:
    sound = {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version": "13", "Upgrade": "websocket"}
    for path, more, status in (
        ("/ws", {"Host": "evil.example"}, 421),
        ("/nothing", {}, 403),
        ("/ws", {"Sec-WebSocket-Key": "x"}, 400),
        ("/ws", {"Sec-WebSocket-Version": "12"}, 400),
        ("/ws", {"Sec-WebSocket-Extensions": ";;"}, 400),
    ):
        with closing(HTTPConnection("127.0.0.1", port, timeout=10.0)) as connection:
            connection.request("GET", path, headers={"Connection": "Upgrade", **sound, **more})
            with connection.getresponse() as response:
                assert response.status == status, more
                assert bears_headers({name.lower(): value for name, value in response.getheaders()})


def test_gate__websockets_that_are_refused_or_gone__are_no_errors_of_the_log(port: int, caplog, monkeypatch) -> None:
    monkeypatch.setattr(logging.getLogger("uvicorn.error"), "propagate", True)
    monkeypatch.setattr(logging.getLogger("uvicorn"), "propagate", True)
    head = "GET {} HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    head += "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    for path in ("/nothing", "/ws", "/closed") * 20:
        with socket.create_connection(("127.0.0.1", port), timeout=10.0) as made:
            made.sendall(head.format(path).encode())
    assert asked(port, "localhost")[0] == 200
    with connect(f"ws://127.0.0.1:{port}/ws") as last:
        last.send("the others are through")
        assert last.recv() == "the others are through"
    assert defects(caplog) == []


def test_address__certificate__encrypts_pages_and_answers_to_the_names_told() -> None:
    address = Address(names=("lab.example",), certificate=TLS / "certificate.pem", key=TLS / "key.pem")
    sock = address.listen()
    server = uvicorn.Server(address.config(small(), time.monotonic))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]}, daemon=True)
    thread.start()
    try:
        port = sock.getsockname()[1]
        assert address.base_url(sock) == f"https://127.0.0.1:{port}"
        trusting = ssl.create_default_context(cafile=str(TLS / "certificate.pem"))
        with closing(HTTPSConnection("127.0.0.1", port, context=trusting, timeout=10.0)) as connection:
            connection.request("GET", "/", headers={"Host": "lab.example"})
            with connection.getresponse() as response:
                assert response.status == 200
        with connect(f"wss://127.0.0.1:{port}/ws", ssl=trusting) as socket:
            socket.send("hello")
            assert socket.recv() == "hello"
        with pytest.raises(OSError):
            asked(port, "localhost")
    finally:
        server.should_exit = True
        thread.join(timeout=10.0)
        sock.close()


def test_address__files_that_are_no_pair__are_refused_in_one_line(tmp_path, run) -> None:
    for certificate, key, message in (
        (None, "key.pem", "a TLS key without a certificate"),
        ("certificate.pem", None, "no pair"),
        ("certificate.pem", "other.pem", "no pair"),
        ("certificate.pem", "locked.pem", "no pair without a password"),
        ("nothing.pem", "key.pem", "No such file"),
        ("key.pem", "certificate.pem", "no pair"),
    ):
        with pytest.raises(BadInput, match=message):
            Address(certificate=certificate and TLS / certificate, key=key and TLS / key)
    (path := tmp_path / "protocol.toml").write_text(PROTOCOL)
    options = ("--tls-certificate", TLS / "certificate.pem", "--tls-key", TLS / "other.pem", "--port", "0")
    run.refused("experiment", "serve", path, "--store", tmp_path / "lab.db", *options, said="no pair")


def half_open(port: int) -> socket.socket:
    made = socket.create_connection(("127.0.0.1", port), timeout=10.0)
    made.sendall(b"GET / HTTP/1.1\r\nHost: ")
    return made


def closed(one: socket.socket) -> bool:
    try:
        return one.recv(1) == b""
    except ConnectionResetError:
        return True


def test_connections__beyond_the_limit__closed_and_the_open_session_goes_on(client, lab, monkeypatch) -> None:
    monkeypatch.setattr(serving, "CONNECTIONS_PER_ADDRESS_MAX", 8)
    monkeypatch.setattr(serving, "HEADER_TIMEOUT_S", 1e6)  # which would close them, too
    with client.websocket_connect("/ws/subject/token-S1") as subject:
        trial = begun(subject)
        held = [half_open(client.port) for _ in range(40)]
        assert sum(closed(one) for one in held[7:]) == 33
        subject.send_json({"type": "pause"})
        assert until(subject, "stage")
        assert trial["type"] == "answer-now"
        for one in held:
            one.close()
    assert client.get("/").status == 200


def test_connections__beyond_the_limit_and_without_a_handshake__closed_and_a_place_that_is_left_is_taken(monkeypatch):
    monkeypatch.setattr(serving, "CONNECTIONS_MAX", 8)
    app = FastAPI()
    with served(app, ssl_certfile=TLS / "certificate.pem", ssl_keyfile=TLS / "key.pem") as client:
        held = [socket.create_connection(("127.0.0.1", client.port), timeout=10.0) for _ in range(20)]
        assert sum(closed(one) for one in held[8:]) == 12
        held[0].close()
        heard = (heard_encrypted(client.port) for _ in range(600))  # it may not know yet that a place is left
        assert next(filter(None, heard)).startswith(b"HTTP/1.1 404")
        for one in held:
            one.close()


def heard_encrypted(port: int) -> bytes:
    with (
        suppress(OSError),
        socket.create_connection(("127.0.0.1", port), timeout=10.0) as one,
        unchecked().wrap_socket(one) as encrypted,
    ):
        encrypted.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        return encrypted.recv(4096)
    time.sleep(0.05)
    return b""


def unchecked() -> ssl.SSLContext:
    made = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    made.check_hostname, made.verify_mode = False, ssl.CERT_NONE
    return made


def test_head__that_never_comes_or_is_no_http__is_not_waited_for_or_answered_with_every_pages_headers(
    client, monkeypatch
) -> None:
    with socket.create_connection(("127.0.0.1", client.port), timeout=10.0) as one:
        one.sendall(b"\x00\x01nonsense\r\n\r\n")
        answer = b"".join(iter(lambda: one.recv(4096), b""))
    assert answer.startswith(b"HTTP/1.1 400")
    assert b"nosniff" in answer
    assert b"default-src 'self'" in answer
    monkeypatch.setattr(serving, "HEADER_TIMEOUT_S", 0.1)
    with half_open(client.port) as one:
        assert closed(one)


@pytest.mark.parametrize("streams", [False, True])
def test_request__that_is_no_http_in_its_body__ends_the_answer_without_a_word_in_the_log(monkeypatch, caplog, streams):
    """The answer was written after the refusal, or the refusal after the answer's beginning: a traceback each."""

    async def app(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})
        if streams:
            await asyncio.sleep(0.1)
        await send({"type": "http.response.body", "body": b"late"})

    head, nonsense = (
        b"POST / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n",
        b"this is no length\r\n",
    )
    with served(app) as client, socket.create_connection(("127.0.0.1", client.port), timeout=10.0) as one:
        hear_all(monkeypatch)
        one.sendall(head if streams else head + nonsense)
        if streams:
            time.sleep(0.03)
            one.sendall(nonsense)
        answer = b"".join(iter(lambda: one.recv(4096), b""))
        assert answer.startswith(b"HTTP/1.1 200" if streams else b"HTTP/1.1 400")
        time.sleep(0.1)
    assert defects(caplog) == []


def test_log__a_flood_of_lines__is_limited_and_told_and_silences_no_defect(caplog) -> None:
    now = [0.0]
    logger = logging.getLogger("tests.flood")
    logger.addFilter(serving.LogLimit(lambda: now[0]))
    for _ in range(1000):
        logger.warning("again")
    assert len(caplog.records) == 15
    for _ in range(20):
        logger.error("a defect")
    assert len(caplog.records) == 30
    now[0] = 61.0
    logger.warning("later")
    assert caplog.records[-1].getMessage() == "later (990 lines before it were left out)"


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
    with pytest.raises(BadInput, match="No such file"):
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


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.soak)])
def test_study__fuzzed_requests__keep_the_open_session_going(client, lab, caplog, monkeypatch, goes_on, count):
    paths = ["/", "/static/common.css", "/s/token-S1", "/s/nobody", "/operator", "/ws/subject/token-S1", "/ws/operator"]
    answered = requesting.fuzz(client.port, requesting.heads(paths, TOKEN), count, caplog, monkeypatch, goes_on)
    assert answered > count // 4
    assert lab.fault is None
