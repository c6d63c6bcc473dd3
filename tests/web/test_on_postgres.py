"""Verbs whose store, or whose shared store, is a PostgreSQL server's, from the command line to the rows."""

import random
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import pytest

from tactuator.cli.main import main
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.store.merge import Shared
from tactuator.experiment.store.store import Store
from tactuator.io.controller import write_controller
from tactuator.verbs.store import verify
from tests.experiment.session.apparatuses import PROTOCOL, answers, controller
from tests.postgres import PostgresServer
from tests.web.killing import LONG, Client
from tests.web.study import Server

pytestmark = pytest.mark.slow
ONE = PROTOCOL[: PROTOCOL.rindex("[[subject]]")]


@pytest.fixture(scope="module")
def postgres() -> Iterator[PostgresServer]:
    made = PostgresServer()
    yield made
    made.close()


@contextmanager
def serving(folder: Path, *more: str, text: str = ONE) -> Iterator[Server]:
    """`experiment serve` with those options, killed at the end."""
    folder.mkdir(exist_ok=True)
    (folder / "protocol.toml").write_text(text)
    write_controller(folder / "controller.json", controller())
    server = Server(folder / "protocol.toml", folder / "own.db", folder / "controller.json", more=more)
    server.start()
    try:
        yield server
    finally:
        server.kill()


def test_serve__store_on_a_server__is_gone_on_with_after_a_kill(tmp_path, postgres) -> None:
    place = postgres.database("served")
    with serving(tmp_path, "--store", place) as server:
        client = Client(server, parse_protocol(ONE, Protocol))
        client.answers(until=6)
        server.kill()
        server.start()
        client.answers(until=12)
    assert [(row[1] + 1, row[2]) for row in answers(place)][:12] == client.acknowledged
    assert verify(place).holds
    assert not (tmp_path / "own.db").exists()


def test_serve__shared_store_on_a_server__gets_every_answer_of_the_station(tmp_path, postgres) -> None:
    place = postgres.database("shared")
    with serving(tmp_path, "--shared", place) as server:
        client = Client(server, parse_protocol(ONE, Protocol))
        client.answers(until=8)
        postgres.kill()
        client.answers(until=12)
        postgres.start()
        for _ in range(600):  # an exchange follows each second
            if len(answers(place)) == 12:
                break
            time.sleep(0.1)
    assert answers(place) == answers(tmp_path / "own.db")
    assert verify(place).holds


def test_simulated_people__store_on_a_server__answer_there(tmp_path, monkeypatch, postgres) -> None:
    monkeypatch.chdir(tmp_path)
    place = postgres.database("observe")
    write_controller(Path("controller.json"), controller())
    Path("protocol.toml").write_text(ONE.replace("[30, 90, 210]", "[30]"))
    assert main(["experiment", "observe", "protocol.toml", "--store", place, "--controller", "controller.json"]) == 0
    assert len(answers(place)) > 20
    assert verify(place).holds


def answering(client: Client, over: threading.Event) -> None:
    while not over.is_set():
        client.answers(until=10**9)
        time.sleep(0.1)


@pytest.mark.parametrize(("count", "kills"), [(3, 8), pytest.param(20, 1000, marks=pytest.mark.soak)])
def test_stations__killed_with_their_server__lose_and_double_nothing(tmp_path, postgres, count, kills) -> None:
    """A station, each eighth time the server, is killed at a random instant after another answer, and started again."""
    place, rng, over = postgres.database("killed"), random.Random(7), threading.Event()
    text = LONG[: LONG.index("[[subject]]")] + "".join(f'[[subject]]\ncode = "S{each + 1}"\n' for each in range(count))
    protocol, folders = parse_protocol(text, Protocol), [tmp_path / str(each) for each in range(count)]
    with ExitStack() as running:
        servers = [running.enter_context(serving(each, "--shared", place, text=text)) for each in folders]
        clients = [Client(server, protocol, index, 0.05 * count) for index, server in enumerate(servers)]
        threads = [threading.Thread(target=answering, args=(client, over), daemon=True) for client in clients]
        for thread in threads:
            thread.start()
        for kill in range(kills):
            given = sum(len(client.acknowledged) for client in clients)
            while sum(len(client.acknowledged) for client in clients) <= given + count:
                time.sleep(0.05)
            time.sleep(rng.uniform(0.0, 0.4))
            struck = postgres if kill % 8 == 5 else rng.choice(servers)
            struck.kill()
            struck.start()
        over.set()
    for thread in threads:
        thread.join(timeout=60.0)
    for folder in folders:  # what a station had not brought when it was killed
        with closing(Store(folder / "own.db")) as own, closing(Shared(own, place)) as shared:
            shared.exchange()
    stored = answers(place)
    assert sorted(stored) == sorted(each for folder in folders for each in answers(folder / "own.db"))
    keys = [row[:3] for row in stored]
    assert len(set(keys)) == len(keys) >= count * kills
    said = {(f"S{each.index + 1}", run - 1, number) for each in clients for run, number in each.acknowledged}
    assert said <= set(keys)
    assert verify(place).holds
