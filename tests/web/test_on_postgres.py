"""A study at several stations, whose store is a PostgreSQL server's, from the command line to the rows."""

import random
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import pytest
from anyio.from_thread import start_blocking_portal

from tactuator.cli.main import main
from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.protocol.study import SubjectPart
from tactuator.experiment.store.store import Store
from tactuator.io.controller import write_controller
from tactuator.web.lab import Lab
from tactuator.web.study_pages import build_app
from tests.experiment.session.apparatuses import (
    PROTOCOL,
    ObedientClock,
    answer_one,
    answers,
    begin,
    controller,
    opened_study,
)
from tests.postgres import PostgresServer
from tests.web.killing import LONG, Client
from tests.web.server import served
from tests.web.study import Server

pytestmark = pytest.mark.slow
ONE = PROTOCOL[: PROTOCOL.rindex("[[subject]]")]


@pytest.fixture(scope="module")
def postgres() -> Iterator[PostgresServer]:
    made = PostgresServer()
    yield made
    made.close()


@contextmanager
def serving(folder: Path, place: str, text: str = ONE) -> Iterator[Server]:
    """`experiment serve` with the store at that place, killed at the end."""
    folder.mkdir(exist_ok=True)
    (folder / "protocol.toml").write_text(text)
    write_controller(folder / "controller.json", controller())
    server = Server(folder / "protocol.toml", folder / "own.db", folder / "controller.json", more=("--store", place))
    server.start()
    try:
        yield server
    finally:
        server.kill()


def test_serve__store_on_a_server__is_gone_on_with_after_a_kill(tmp_path, postgres) -> None:
    place = postgres.database("served")
    with serving(tmp_path, place) as server:
        client = Client(server, parse_protocol(ONE, Protocol))
        client.answers(until=6)
        server.kill()
        server.start()
        client.answers(until=12)
    assert {(row[1], row[2]) for row in answers(place)[:12]} == client.answered()


def test_simulated_people__store_on_a_server__answer_there(tmp_path, monkeypatch, postgres) -> None:
    monkeypatch.chdir(tmp_path)
    place = postgres.database("observe")
    write_controller(Path("controller.json"), controller())
    Path("protocol.toml").write_text(ONE.replace("[30, 90, 210]", "[30]"))
    assert main(["experiment", "observe", "protocol.toml", "--store", place, "--controller", "controller.json"]) == 0
    assert len(answers(place)) > 20


def test_visit__open_at_two_stations__is_stored_once(postgres) -> None:
    place, clock = postgres.database("visit"), ObedientClock()
    with closing(Store(place)) as one, closing(Store(place)) as two, start_blocking_portal() as server:
        lab = Lab(opened_study(two, clock))
        row = lab.sessions[0]
        server.call(lab.session, row)
        first = begin(one, clock, trials=3)
        second = server.call(lab.session, row)  # as it was before
        second.give_consent()
        with pytest.raises(BadInput, match="the visit of subject S1 goes on at another station"):
            second.present(lambda interval, begins: None)
        server.call(lab.catch_up, row)
        second = server.call(lab.session, row)
        assert [answer_one(at, clock) for at in (second, second)] == [(1, 1), (1, 2)]
        with pytest.raises(StoreFault, match="another station has gone on with this visit"):
            answer_one(first, clock)
        lab.close()
    keys = [row[:3] for row in answers(place)]
    assert len(set(keys)) == len(keys) == 5


def test_subject__enrolled_at_another_station__has_a_page_here(postgres) -> None:
    place, clock = postgres.database("enrolled"), ObedientClock()
    with closing(Store(place)) as one, closing(Store(place)) as two:
        lab = Lab(opened_study(two, clock))
        with served(build_app(lab, "the operator's own")) as client:
            assert client.get("/s/token-S9").status == 404
            with opened_study(one, clock).editing() as study:
                study.enrol(SubjectPart(code="S9"))
            assert client.get("/s/token-S9").status == 200
        lab.close()


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
        servers = [running.enter_context(serving(each, place, text)) for each in folders]
        clients = [Client(server, protocol, index, 0.05 * count) for index, server in enumerate(servers)]
        threads = [threading.Thread(target=answering, args=(client, over), daemon=True) for client in clients]
        for thread in threads:
            thread.start()
        for kill in range(kills):
            given = sum(len(client.acknowledged) for client in clients)
            while sum(len(client.acknowledged) for client in clients) <= given + count:
                assert all(thread.is_alive() for thread in threads), "a client ended"
                time.sleep(0.05)
            time.sleep(rng.uniform(0.0, 0.4))
            struck = postgres if kill % 8 == 5 else rng.choice(servers)
            struck.kill()
            struck.start()
        over.set()
    for thread in threads:
        thread.join(timeout=60.0)
    keys = [row[:3] for row in answers(place)]
    assert len(set(keys)) == len(keys) >= count * kills
    assert {(f"S{each.index + 1}", *answer) for each in clients for answer in each.answered()} <= set(keys)
