"""The application on a real socket, and a client of it."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection
from typing import Any

import uvicorn
from fastapi import FastAPI
from websockets import Origin
from websockets.sync.client import ClientConnection, connect

from tactuator.web.server import Address


@dataclass
class Answer:
    status: int
    headers: dict[str, str]
    text: str


class Socket:
    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection

    def receive_json(self) -> dict[str, Any]:
        return dict(json.loads(self._connection.recv(timeout=10.0)))

    def send_json(self, message: dict[str, Any]) -> None:
        self._connection.send(json.dumps(message))

    def send_text(self, text: str) -> None:
        self._connection.send(text)


@dataclass
class Client:
    port: int

    def get(self, path: str) -> Answer:
        return self.request("GET", path, {})

    def request(self, method: str, path: str, headers: dict[str, str]) -> Answer:
        connection = HTTPConnection("127.0.0.1", self.port, timeout=10.0)
        connection.request(method, path, headers=headers)
        response = connection.getresponse()
        names = {name.title(): value for name, value in response.getheaders()}
        answer = Answer(response.status, names, response.read().decode())
        connection.close()
        return answer

    @contextmanager
    def websocket_connect(self, path: str, origin: str | None = None) -> Iterator[Socket]:
        named = None if origin is None else Origin(origin)
        with connect(f"ws://127.0.0.1:{self.port}{path}", origin=named) as connection:
            yield Socket(connection)


@contextmanager
def served(app: FastAPI, address: Address = Address()) -> Iterator[Client]:
    server, sock = uvicorn.Server(address.config(app, timeout_graceful_shutdown=2)), address.listen()
    thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]}, daemon=True)
    thread.start()
    try:
        yield Client(sock.getsockname()[1])
    finally:
        server.should_exit = True
        thread.join(timeout=10.0)
        sock.close()
