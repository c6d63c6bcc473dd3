"""Labs that are closed at the end of a test, and what their sockets and stores hold."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import pytest
from sqlalchemy import func, select

from tactuator.experiment.session.studies import Study
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tactuator.web.lab import Lab
from tactuator.web.study_pages import build_app
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, opened_study
from tests.web.server import Client, Socket, served

TOKEN = "the operator's own"


@pytest.fixture
def make_lab(tmp_path) -> Iterator[Callable[..., Lab]]:
    made: list[Lab] = []

    def lab(opened: Callable[[Store], Study], auto_start: bool = True, shown: str = "") -> Lab:
        made.append(Lab(opened(Store(tmp_path / "lab.db")), auto_start, shown))
        return made[-1]

    yield lab
    for one in made:
        one.close()
        one.store.close()


@pytest.fixture
def client(lab) -> Iterator[Client]:
    with served(build_app(lab, TOKEN)) as made:
        yield made


def until(socket: Socket, kind: str, heard: list[dict] | None = None) -> dict:
    while True:
        message = socket.receive_json()
        if message["type"] == kind:
            return message
        if heard is not None:
            heard.append(message)


@contextmanager
def joined(client: Client, name: str) -> Iterator[Socket]:
    path = "operator" if name == "operator" else f"subject/token-{name}"
    with client.websocket_connect(f"/ws/{path}") as socket:
        if name == "operator":
            socket.send_text(TOKEN)
        yield socket


@contextmanager
def at_pages(lab: Lab, *names: str) -> Iterator[list[Socket]]:
    with served(build_app(lab, TOKEN)) as made, ExitStack() as closes:
        yield [closes.enter_context(joined(made, name)) for name in names]


@contextmanager
def at_page(lab: Lab) -> Iterator[Socket]:
    with at_pages(lab, "S1") as (socket,):
        yield socket


def agreed(socket: Socket) -> None:
    stage(socket, "consent")
    socket.send_json({"type": "consent"})
    go_on(socket, "trial")


def begun(socket: Socket) -> dict:
    agreed(socket)
    return until(socket, "answer-now")


def response_count(lab: Lab) -> int:
    with lab.store.read() as connection:
        return int(connection.execute(select(func.count()).select_from(schema.response)).scalar_one())


@pytest.fixture
def make(make_lab):

    def lab(text=PROTOCOL, auto_start=True, shown=""):
        return make_lab(lambda store: opened_study(store, ObedientClock(), text), auto_start, shown)

    return lab


def stage(socket: Socket, name: str) -> dict:
    while (found := until(socket, "stage"))["stage"] != name:
        pass
    return found


def go_on(socket: Socket, name: str) -> None:
    stage(socket, name)
    socket.send_json({"type": "ready", "stage": name})


def answer(socket: Socket, stands: dict, response: str = "1") -> dict:
    socket.send_json({"type": "answer", "run": stands["run"], "number": stands["number"], "response": response})
    return until(socket, "ack")


@pytest.fixture
def lab(make):
    return make()
