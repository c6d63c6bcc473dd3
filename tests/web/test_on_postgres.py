"""Verbs whose store, or whose shared store, is a PostgreSQL server's, from the command line to the rows."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tactuator.experiment.protocol.file import parse_protocol
from tactuator.io.controller import write_controller
from tactuator.verbs.store import verify
from tests.experiment.session.apparatuses import PROTOCOL, controller
from tests.experiment.store.killing_stations import answers
from tests.postgres import PostgresServer
from tests.web.killing import Client
from tests.web.study import Server

pytestmark = pytest.mark.xdist_group("postgres")
ONE = PROTOCOL[: PROTOCOL.rindex("[[subject]]")]


@pytest.fixture(scope="module")
def postgres() -> Iterator[PostgresServer]:
    made = PostgresServer()
    yield made
    made.close()


@contextmanager
def serving(folder: Path, *more: str) -> Iterator[Server]:
    """`experiment serve` with those options, killed at the end."""
    (folder / "protocol.toml").write_text(ONE)
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
        client = Client(server, parse_protocol(ONE))
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
        client = Client(server, parse_protocol(ONE))
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
