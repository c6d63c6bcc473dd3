"""Stations that share one PostgreSQL store, killed again and again, the server with them."""

import contextlib
import multiprocessing
import random
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sqlalchemy import select

from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.store import schema
from tactuator.experiment.store.merge import Shared
from tactuator.experiment.store.store import Store, opened_store, sessions_of
from tactuator.verbs.store import verify
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin
from tests.postgres import PostgresServer

FORKS = multiprocessing.get_context("forkserver")
_EVERY_S = 0.05
"""Time between answers, and between exchanges, for each station that there is."""
_AT_WORK_S = 300.0
"""At most, until every station has answered once, and then somebody between kills: nobody is killed before."""
_SERVER_SHARE = 0.1
"""Share of the kills that strike the server."""
preloaded: Any = None


def protocol_text(stations: int) -> str:
    """A protocol of a subject for each station, whose session nobody ends."""
    text = PROTOCOL[: PROTOCOL.index("[[subject]]")].replace("break_after_trials = 20", "break_after_trials = 100000")
    text = text.replace("reversals = 6", "reversals = 900").replace("averaged = 4", "averaged = 890")
    text = text.replace("resume_within_s = 600", "resume_within_s = 80000")
    return text + "".join(f'[[subject]]\ncode = "S{number}"\n' for number in range(stations))


def station(folder: str, number: int, text: str, shared: str) -> None:
    """One station: its subject answers as fast as the rig plays; what is acknowledged goes to a file, as to a page."""
    wait_s = _EVERY_S * text.count("[[subject]]")
    own_path, clock = Path(folder) / f"station{number}.db", ObedientClock()
    with sessions_of(own_path), opened_store(own_path) as own:
        sharing = Shared(own, shared)
        threading.Thread(target=_exchange, args=(sharing, wait_s), daemon=True).start()
        presented = begin(own, clock, text, number)
        with (Path(folder) / f"acknowledged{number}").open("a") as told:
            while presented.session.stage != "done":
                try:
                    position, trial = answer_one(presented, clock)
                except StoreFault:  # the station's own file was busy: the page sends the answer again
                    continue
                told.write(f"{position} {trial}\n")
                told.flush()
                time.sleep(wait_s)


def _exchange(sharing: Shared, wait_s: float) -> None:
    while True:
        with contextlib.suppress(BadInput, StoreFault):
            sharing.exchange()
        time.sleep(wait_s)


@dataclass
class Stations:
    """Stations and their server, killed by a generator of the given seed."""

    folder: Path
    count: int
    seed: int
    kills: int = 0
    server_kills: int = 0
    server: PostgresServer = field(default_factory=PostgresServer)
    _processes: dict[int, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.shared = self.server.database("study")
        self.text = protocol_text(self.count)
        for number in range(self.count):
            self._start(number)
        self._wait(lambda: all(self._told(number) for number in range(self.count)))

    def _wait(self, reached: Callable[[], bool]) -> None:
        end = time.monotonic() + _AT_WORK_S
        while time.monotonic() < end and not reached():
            time.sleep(0.1)

    def _start(self, number: int) -> None:
        arguments = (str(self.folder), number, self.text, self.shared)
        self._processes[number] = FORKS.Process(target=station, args=arguments, daemon=True)
        self._processes[number].start()

    def kill(self) -> None:
        """Kill a station, or the server, at a random instant after another answer, and start it again at another."""
        rng = random.Random(f"{self.seed}/{self.kills}")
        self.kills += 1
        told = self.count + self.kills
        self._wait(lambda: sum(self._told(number).count("\n") for number in range(self.count)) >= told)
        time.sleep(rng.uniform(0.0, 0.4))
        if rng.random() < _SERVER_SHARE:
            self.server_kills += 1
            self.server.kill()
            time.sleep(rng.uniform(0.0, 1.0))
            self.server.start()
        else:
            number = rng.randrange(self.count)
            self._processes[number].kill()
            self._processes[number].join()
            self._start(number)

    def stop(self) -> None:
        """Kill every station, and let what each has come to the shared store."""
        for process in self._processes.values():
            process.kill()
            process.join()
        for number in range(self.count):
            with closing(Store(self.folder / f"station{number}.db")) as own:
                sharing = Shared(own, self.shared)
                sharing.exchange()
                sharing.close()

    def compare(self) -> dict[str, int]:
        """Hold the shared store against what was acknowledged and against each station's own store."""
        stored = Counter(answers(self.shared))
        acknowledged = {
            (f"S{number}", *map(int, line.split()))
            for number in range(self.count)
            for line in self._told(number).splitlines()
        }
        own = Counter(each for number in range(self.count) for each in answers(self.folder / f"station{number}.db"))
        keys = Counter(each[:3] for each in stored.elements())
        return {
            "acknowledged": len(acknowledged),
            "stored": stored.total(),
            "lost": len(acknowledged - set(keys)),
            "doubled": sum(count - 1 for count in keys.values()),
            "unlike the station's": sum(((own - stored) + (stored - own)).values()),
            "altered": len(verify(self.shared).altered),
        }

    def _told(self, number: int) -> str:
        path = self.folder / f"acknowledged{number}"
        return path.read_text() if path.exists() else ""


def answers(place: str | Path) -> list[tuple[Any, ...]]:
    """Every answer of a store: subject, position of the run, number, and what was presented and answered."""
    run, trial, response = schema.run, schema.trial, schema.response
    query = select(
        schema.subject.c.code, run.c.position, trial.c.number, run.c.attempt, trial.c.level_db_sl,
        trial.c.correct_response, trial.c.presented_utc, response.c.response, response.c.server_received_utc,
    ).select_from(schema.ANSWERED)  # fmt: skip
    with closing(Store(place)) as store, store.read() as connection:
        return [tuple(row) for row in connection.execute(query)]


def killed(folder: Path, stations: int, kills: int, seed: int) -> tuple[Stations, dict[str, int]]:
    """Kill so often; then stop, and compare."""
    FORKS.set_forkserver_preload(["tests.experiment.store.warm_stations"])
    lab = Stations(folder, stations, seed)
    try:
        while lab.kills < kills:
            lab.kill()
        lab.stop()
        return lab, lab.compare()
    finally:
        for process in lab._processes.values():
            process.kill()
        lab.server.close()
