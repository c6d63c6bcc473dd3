"""A subject of a server that may be killed, and the answers of one that was not."""

import json
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from sqlalchemy import select
from websockets.exceptions import ConnectionClosed, InvalidMessage
from websockets.sync.client import connect

from tactuator.experiment.procedure.procedure import Placement
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, begin, everything, response_of
from tests.web.study import Server

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
        self._positions = [run.position for run in protocol.runs(index)]
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
        seed = self.protocol.run_seed(self.index, position, 0)
        return self.protocol.paradigm.trial(number, "index", Placement(0.0, 100.0), seed)


def of_first(path: Path) -> list[tuple[Any, ...]]:
    """Every answer of the first subject, with its trial."""
    query = (
        select(
            schema.run.c.position, schema.run.c.protocol_version_id, schema.trial.c.number,
            schema.trial.c.level_db_sl, schema.trial.c.correct_response, schema.response.c.response,
        )
        .select_from(schema.subject.join(schema.session).join(schema.run).join(schema.trial).join(schema.response))
        .where(schema.subject.c.code == "S1")
        .order_by(schema.trial.c.id)
    )  # fmt: skip
    with closing(Store(path)) as store, store.read() as connection:
        return [tuple(row) for row in connection.execute(query)]


def undisturbed(path: Path, text: str) -> list[tuple[Any, ...]]:
    clock, store = ObedientClock(), Store(path)
    everything(begin(store, clock, text), clock)
    store.close()
    return of_first(path)
