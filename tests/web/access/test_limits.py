"""The server's limits: connections, heads that never come, lines of log, tokens, and who reads the store."""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl
import stat
import time
from contextlib import suppress
from pathlib import Path

import pytest
from fastapi import FastAPI

from tactuator.errors import BadInput
from tactuator.experiment.store.store import Store
from tactuator.web import serve
from tactuator.web import server as serving
from tests.experiment.session.apparatuses import ObedientClock, opened_study
from tests.web.access.mutating import defects, hear_all
from tests.web.labs import begun, client, make_lab, until  # noqa: F401
from tests.web.server import served

TLS = Path(__file__).parent / "tls"


@pytest.fixture
def lab(make_lab):
    return make_lab(lambda store: opened_study(store, ObedientClock()))


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


def test_connections__beyond_the_limit_and_without_a_handshake__closed_and_a_place_that_is_left_is_taken(
    monkeypatch,
) -> None:
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
    """The head of an answer; nothing where the connection is closed."""
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
def test_request__that_is_no_http_in_its_body__ends_the_answer_without_a_word_in_the_log(
    monkeypatch, caplog, streams
) -> None:
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


def test_operator_token__of_file_environment_or_fresh__is_taken_unless_it_may_be_guessed(tmp_path, monkeypatch) -> None:
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


def test_store__made__is_read_by_its_owner_alone(tmp_path: Path) -> None:
    Store(tmp_path / "lab.db").close()
    assert stat.S_IMODE((tmp_path / "lab.db").stat().st_mode) == 0o600
