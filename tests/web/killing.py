"""A session whose server is killed again and again while its protocol is amended."""

import json
import random
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import select
from websockets.exceptions import ConnectionClosed, InvalidMessage
from websockets.sync.client import connect

from tactuator.experiment.procedure.procedure import Placement
from tactuator.experiment.protocol.detection import plan_runs
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.protocol.study import run_seed
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, begin, controller, everything, response_of
from tests.web.study import Server, started

ONE = PROTOCOL[: PROTOCOL.rindex("[[subject]]")].replace("break_after_trials = 20", "break_after_trials = 100000")
LONG = ONE.replace("reversals = 6", "reversals = 240").replace("averaged = 4", "averaged = 230")
LONG = LONG.replace("resume_within_s = 600", "resume_within_s = 80000")  # on a busy machine


class Client:
    """A subject over the socket, who answers right but for every fourth trial, and knows what was acknowledged."""

    def __init__(self, server: Server, protocol: Any, index: int = 0, wait_s: float = 0.0) -> None:
        self.protocol, self.index, self.wait_s = protocol, index, wait_s
        self._path = server.addresses[f"subject S{index + 1}"].replace("http", "ws").replace("/s/", "/ws/subject/")
        self.acknowledged: list[tuple[int, int]] = []
        self.done = False
        self._positions = [run.position for run in plan_runs(protocol, index)]
        self.runs: dict[int, int] = {}  # position by row, without a restart

    def answered(self) -> set[tuple[int, int]]:
        return {(self.runs[run], number) for run, number in self.acknowledged}

    def answers(self, until: int) -> None:
        with suppress(ConnectionClosed, InvalidMessage, OSError), connect(self._path) as socket:
            while len(self.acknowledged) < until and not self.done:
                self._take(socket, json.loads(socket.recv(timeout=30.0)))

    def _take(self, socket: Any, message: Any) -> None:
        if message["type"] == "stage":
            self.done = message["stage"] == "done"
            if message["stage"] == "consent":
                socket.send('{"type": "consent"}')
            elif not self.done:
                socket.send(json.dumps({"type": "ready", "stage": message["stage"]}))
        elif message["type"] == "answer-now":
            run, number = message["run"], message["number"]
            trial = self._trial(run, number)
            time.sleep(self.wait_s)
            socket.send(json.dumps({"type": "answer", "run": run, "number": number, "response": response_of(trial)}))
        elif message["type"] == "fault":
            raise ConnectionError  # opened again, as a page would be
        elif message["type"] == "ack":
            self.acknowledged.append((message["run"], message["number"]))

    def _trial(self, run: int, number: int) -> Any:
        position = self.runs.setdefault(run, self._positions[len(self.runs) % len(self._positions)])
        seed = run_seed(self.protocol, self.index, position, 0)
        return self.protocol.paradigm.trial(number, Placement(0.0), seed)


@dataclass
class Killing:
    """What has been done to the session so far.

    first: the protocol's first version. every: so many kills there is another version. seed: of the moments of kills.
    """

    folder: Path
    first: str
    every: int
    seed: int
    kills: int = 0
    versions: int = 1

    def __post_init__(self) -> None:
        self.server = started(self.folder, self.first, controller())
        self.client = Client(self.server, parse_protocol(self.first, Protocol))
        self.link = self._link()

    def _link(self) -> str:
        return self.server.addresses["subject S1"].rsplit("/", 1)[1]

    def kill(self) -> None:
        rng = random.Random(f"{self.seed}/{self.kills}")
        self.client.answers(len(self.client.acknowledged) + rng.randrange(1, 4))
        if not self.client.done:
            timer = threading.Timer(rng.uniform(0.0, 0.08), self.server.kill)
            timer.start()
            self.client.answers(10**9)
            timer.join()
            self.kills += 1
            if self.kills % self.every == 0:
                text, self.server.more = amended(self.server.protocol.read_text(), self.kills // self.every)
                self.server.protocol.write_text(text)
                self.versions += 1
            self.server.start()
            self.server.more = ()
            assert self._link() == self.link

    def compare(self) -> int:
        stored = of_first(self.server.store)
        assert stored[:2] == (0, self.link)
        assert stored[2] == 1
        assert {row[1] for row in stored[3]} == {1}
        assert sorted(stored[4]) == list(range(1, self.versions + 1))
        assert stored[5] == []
        there = [(row[0], row[2]) for row in stored[3]]
        assert len(set(there)) == len(there)
        assert self.client.answered() <= set(there)
        whole = undisturbed(self.folder / "whole.db", self.first)
        assert stored[3] == (whole if self.client.done else whole[: len(there)])
        return len(there)


def amended(text: str, number: int) -> tuple[str, tuple[str, ...]]:
    """The protocol's next version: every other one only enrols somebody, first in the file; the rest change it."""
    someone = f'[[subject]]\ncode = "N{number}"\n'
    if number % 2:
        return text.replace("[[subject]]", f"{someone}[[subject]]", 1), ()
    hertz = "50, 100, 200" if f"[50, 100, 200, {250 + number}" in text else f"50, 100, 200, {240 + number / 10}"
    start = text.index("frequencies_hz = [")
    changed = text[:start] + f"frequencies_hz = [{hertz}]" + text[text.index("]", start) + 1 :]
    return changed, ("--amend", f"version {number}")


def of_first(path: Path) -> tuple[Any, ...]:
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


def undisturbed(path: Path, text: str) -> list[tuple[Any, ...]]:
    if not path.exists():
        clock, store = ObedientClock(), Store(path)
        everything(begin(store, clock, text), clock)
        store.close()
    return of_first(path)[3]


def kills_across_amendments(folder: Path, text: str, kills: int, every: int, seed: int) -> tuple[int, Killing]:
    killing = Killing(folder, text, every, seed)
    try:
        while killing.kills < kills and not killing.client.done:
            killing.kill()
        killing.client.answers(10**9)
    finally:
        killing.server.kill()
    return killing.compare(), killing
