"""Which names the server answers to, what its refusals bear, and its encrypted connection."""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl
import threading
import time
from contextlib import closing, suppress
from http.client import HTTPConnection, HTTPSConnection
from pathlib import Path

import pytest
import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect
from websockets.sync.client import connect

from tactuator.cli import main
from tactuator.errors import BadInput
from tactuator.web.pages import HEADERS, plain_text
from tactuator.web.server import Address
from tests.experiment.session.apparatuses import PROTOCOL
from tests.web.access.mutating import defects
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


def test_address__files_that_are_no_pair__are_refused() -> None:
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


def test_serve__key_that_is_no_key__status_2_and_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "protocol.toml"
    path.write_text(PROTOCOL)
    options = ["--tls-certificate", str(TLS / "certificate.pem"), "--tls-key", str(TLS / "other.pem"), "--port", "0"]
    assert main(["experiment", "serve", str(path), "--store", str(tmp_path / "lab.db"), *options]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "lab.db").exists()
