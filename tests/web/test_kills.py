"""A server that is killed again and again while the protocol is amended: no answer is lost, doubled or changed."""

import json
import random
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from sqlalchemy import select
from websockets.exceptions import ConnectionClosed, InvalidMessage
from websockets.sync.client import connect

from tactuator.experiment.procedure.procedure import Placement
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.protocol.plan import plan_runs, run_seed
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin, controller, response_of
from tests.web.study import Server, started

ONE = PROTOCOL[: PROTOCOL.rindex("[[subject]]")].replace("break_after_trials = 20", "break_after_trials = 100000")


class Client:
    """Subject S1 over the socket, who answers right but for every fourth trial, and knows what was acknowledged."""

    def __init__(self, server: Server, protocol) -> None:
        self.server, self.protocol = server, protocol
        self.acknowledged: list[tuple[int, int]] = []
        self.done = False
        self._positions = [run.position for run in plan_runs(protocol, 0)]

    def answers(self, until: int) -> None:
        """Answer until so many are acknowledged, or the session is over; the connection may end at any moment."""
        path = self.server.addresses["subject S1"].replace("http", "ws").replace("/s/", "/ws/subject/")
        with suppress(ConnectionClosed, InvalidMessage, OSError), connect(path) as socket:
            while len(self.acknowledged) < until and not self.done:
                self._take(socket, json.loads(socket.recv(timeout=30.0)))

    def _take(self, socket, message) -> None:
        if message["type"] == "stage":
            self.done = message["stage"] == "done"
            if message["stage"] == "consent":
                socket.send('{"type": "consent"}')
            elif not self.done:
                socket.send(json.dumps({"type": "ready", "stage": message["stage"]}))
        elif message["type"] == "answer-now":
            run, number = message["run"], message["number"]
            trial = self._trial(run, number)
            socket.send(json.dumps({"type": "answer", "run": run, "number": number, "response": response_of(trial)}))
        elif message["type"] == "ack":
            self.acknowledged.append((message["run"], message["number"]))

    def _trial(self, run, number):
        seed = run_seed(self.protocol, 0, self._positions[run - 1], 0)  # no restart: rows are positions
        return self.protocol.forced_choice().trial(number, Placement(0.0), seed)


def amended(text: str, number: int) -> tuple[str, tuple[str, ...]]:
    """The protocol's next version: every other one only enrols somebody, first in the file; the rest change it."""
    someone = f'[[subject]]\ncode = "N{number}"\n'
    if number % 2:
        return text.replace("[[subject]]", f"{someone}[[subject]]", 1), ()
    hertz = "50, 100, 200" if f"[50, 100, 200, {250 + number}" in text else f"50, 100, 200, {240 + number / 10}"
    start = text.index("frequencies_hz = [")
    changed = text[:start] + f"frequencies_hz = [{hertz}]" + text[text.index("]", start) + 1 :]
    return changed, ("--amend", f"version {number}")


def of_first(path: Path):
    """What the store has of S1: link, number, versions, runs, trials and answers."""
    store = Store(path)
    with store.read() as connection:
        who = connection.execute(select(schema.subject).where(schema.subject.c.code == "S1")).one()
        session = connection.execute(select(schema.session).where(schema.session.c.subject_id == who.id)).one()
        rows = connection.execute(
            select(
                schema.run.c.position, schema.run.c.protocol_version_id, schema.trial.c.number,
                schema.trial.c.level_db_sl, schema.trial.c.correct_response, schema.response.c.response,
            )
            .select_from(schema.run.join(schema.trial).join(schema.response))
            .where(schema.run.c.session_id == session.id)
            .order_by(schema.trial.c.id)
        ).all()  # fmt: skip
        numbers = connection.execute(select(schema.protocol_version.c.number)).scalars().all()
        orphans = connection.exec_driver_sql("PRAGMA foreign_key_check").all()
    store.close()
    return who.number, session.link_token, session.protocol_version_id, [tuple(row) for row in rows], numbers, orphans


def undisturbed(path: Path, text: str):
    clock, store = ObedientClock(), Store(path)
    presented = begin(store, clock, text)
    while presented.session.stage != "done":
        answer_one(presented, clock)
    store.close()
    return of_first(path)[3]


def kills_across_amendments(folder: Path, text: str, kills: int, every: int, seed: int) -> tuple[int, int]:
    """Kill `kills` times, with another version of the protocol `every` so many kills; answers and versions there were.

    A moment: up to three answers on, then whatever goes on at a random instant of the next trial.
    """
    rng, first, server = random.Random(seed), text, started(folder, text, controller())
    client, link, versions = Client(server, parse_protocol(text)), server.addresses["subject S1"].rsplit("/", 1)[1], 1
    for number in range(1, kills + 1):
        client.answers(len(client.acknowledged) + rng.randrange(1, 4))
        if client.done:
            break
        _kill_within(server, client, rng.uniform(0.0, 0.08))
        if number % every == 0:
            text, server.more = amended(text, number // every)
            server.protocol.write_text(text)
            versions += 1
        server.start()
        server.more = ()
        assert server.addresses["subject S1"].rsplit("/", 1)[1] == link
    client.answers(10**9)
    server.kill()
    stored = of_first(server.store)
    assert stored[0:1] == (0,)
    assert stored[1] == link
    assert stored[2] == 1
    assert {row[1] for row in stored[3]} == {1}
    assert sorted(stored[4]) == list(range(1, versions + 1))
    assert stored[5] == []
    there = [(row[0], row[2]) for row in stored[3]]
    assert len(set(there)) == len(there)
    assert {(run - 1, number) for run, number in client.acknowledged} <= set(there)
    assert stored[3] == undisturbed(folder / "whole.db", first)
    return len(there), versions


def _kill_within(server: Server, client: Client, seconds: float) -> None:
    """Kill the server while the client goes on answering."""
    timer = threading.Timer(seconds, server.kill)
    timer.start()
    client.answers(10**9)
    timer.join()


def test_session__server_killed_while_the_protocol_is_amended__is_the_undisturbed_one(tmp_path) -> None:
    answers, versions = kills_across_amendments(tmp_path, ONE, kills=4, every=2, seed=5)
    assert (answers > 30, versions) == (True, 3)


@pytest.mark.soak
def test_session__three_hundred_kills_across_amendments__loses_and_doubles_nothing(tmp_path) -> None:
    text = ONE.replace("reversals = 6", "reversals = 80").replace("averaged = 4", "averaged = 70")
    answers, versions = kills_across_amendments(tmp_path, text, kills=300, every=10, seed=6)
    assert answers > 600
    assert versions == 31
