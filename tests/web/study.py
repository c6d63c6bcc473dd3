"""A study in a real browser: a server process that may be killed, a page, and a subject who answers by the script."""

import multiprocessing
import os
import random
import re
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tactuator.cli.main import main
from tactuator.experiment.procedure.procedure import Placement
from tactuator.experiment.protocol.file import Protocol, read_protocol
from tactuator.io.controller import write_controller
from tactuator.model.controller import Controller
from tests.experiment.session.apparatuses import response_of

ASKED = ".choice[aria-disabled=false]"
"""A response button while an answer is asked for."""
STANDS = f"""() => {{
    const shows = (one) => document.querySelector(one).checkVisibility();
    return {{
        over: document.querySelector("#status").innerText.startsWith("That was all"),
        done: document.querySelector("#progress").value === 1 && !shows("#choices"),
        go: shows("#go"),
        trial: document.querySelector("{ASKED}, .number input:not([readonly])") && document.body.dataset.trial,
    }};
}}"""
"""Whether the session is over (as told, and as shown), whether to go on, and the trial that is to be answered, or null:
all by one question, since each takes a hundredth of a second of four processes."""


FORKS = multiprocessing.get_context("forkserver")
# what `experiment serve` imports and `main` does not yet: a server comes up in the time of a fork
FORKS.set_forkserver_preload(
    [
        "tactuator.cli.main",
        "tactuator.web.serve",
        "tactuator.console.page_server",
        "uvicorn.protocols.http.h11_impl",
        "uvicorn.protocols.websockets.websockets_sansio_impl",
        "tactuator.web.server",
        "tactuator.rig.open",
    ]
)


def _serve(arguments: list[str], told: Connection) -> None:
    os.dup2(told.fileno(), 2)
    sys.stderr = open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
    sys.exit(main(arguments))


@dataclass
class Server:
    """`tactuator experiment serve` as a process of its own."""

    protocol: Path
    store: Path
    controller: Path
    port: int = 0
    process: Any = None
    addresses: dict[str, str] = field(default_factory=dict)
    more: tuple[str, ...] = ()  # arguments of one's own

    def start(self) -> None:
        arguments = ["experiment", "serve", str(self.protocol), "--store", str(self.store), "--port", str(self.port)]
        token = self.store.with_name("token.txt")
        token.write_text("the operator's own".replace(" ", "-"))
        arguments += ["--controller", str(self.controller), "--operator-token-file", str(token)]
        arguments += ["--speed", "0", "--auto-start", "--no-show", *self.more]
        hears, told = FORKS.Pipe(duplex=False)
        self.process = FORKS.Process(target=_serve, args=(arguments, told), daemon=True)
        self.process.start()
        told.close()
        self.addresses.clear()  # they are printed once the server listens
        with open(hears.fileno(), closefd=False) as lines:
            while len(self.addresses) < 1 + self.protocol.read_text().count("[[subject]]"):
                line = lines.readline()
                assert line, "the server ended"
                name, _, address = line.strip().partition(": ")
                self.addresses[name] = address
                self.port = int(re.search(r":(\d+)/", address)[1])
        hears.close()

    def kill(self) -> None:
        """As a power cut would: SIGKILL."""
        self.process.kill()
        self.process.join()


def started(folder: Path, text: str, controller: Controller) -> Server:
    (folder / "protocol.toml").write_text(text)
    write_controller(folder / "controller.json", controller)
    made = Server(folder / "protocol.toml", folder / "lab.db", folder / "controller.json")
    made.start()
    return made


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[str, Controller], Server]]:
    made: list[Server] = []

    def serve(text: str, controller: Controller) -> Server:
        made.append(started(tmp_path, text, controller))
        return made[-1]

    yield serve
    for one in made:
        one.kill()


@pytest.fixture
def page(browser: Any) -> Iterator[Page]:
    """An empty page, closed at the end; what its scripts throw fails the test."""
    made = browser.new_page()
    errors = watch_errors(made)
    yield made
    made.close()
    assert errors == []


@dataclass
class Subject:
    """Answers whatever the page asks, right but for every fourth trial; knows what was acknowledged."""

    page: Page
    protocol: Path
    key: Callable[[int, int], str] | None = None  # for the row of a run and the number of a trial; default: detection's
    acknowledged: list[tuple[int, int]] = field(default_factory=list)
    asked: Callable[[], None] = lambda: None  # called whenever an answer is asked for

    def __post_init__(self) -> None:
        if self.key is None:
            self._protocol, _ = read_protocol(self.protocol, Protocol)
            self._positions = [run.position for run in self._protocol.runs(0)]
            self.key = self._answer
        self.page.on("websocket", lambda socket: socket.on("framereceived", self._hear))

    def _hear(self, frame: str | bytes) -> None:
        found = re.match(r'\{"type":"ack","run":(\d+),"number":(\d+)', str(frame))
        if found:
            self.acknowledged.append((int(found[1]), int(found[2])))

    def act(self) -> bool:
        """Do the next thing if there is one to do; False once the session is over."""
        stands = self.page.evaluate(STANDS)
        if stands["over"]:
            return False
        if stands["go"]:
            self.page.keyboard.press("Enter")
        elif stands["trial"]:
            self.asked()
            self.page.keyboard.press(self.key(*map(int, stands["trial"].split("/"))))
        self.page.wait_for_timeout(4)
        return True

    def _answer(self, run: int, number: int) -> str:
        seed = self._protocol.run_seed(0, self._positions[run - 1], 0)  # one subject, no restart: rows are positions
        return response_of(self._protocol.paradigm.trial(number, "index", Placement(0.0, 100.0), seed))


def kills_and_finish(server: Server, subject: Subject, kills: int, seed: int) -> int:
    """Kill the server at random moments of the session and start it again, `kills` times; then finish.

    A moment: none to three acknowledged answers on, and up to 60 ms later, whatever is being done then. How many kills
    there were: fewer if the session was over before.
    """
    rng = random.Random(seed)
    for done in range(kills):
        stands = len(subject.acknowledged) + rng.randrange(4)
        while len(subject.acknowledged) < stands:
            if not subject.act():
                return done
        subject.act()
        subject.page.wait_for_timeout(rng.uniform(0.0, 60.0))
        server.kill()
        server.start()
    finish(subject, 600.0)
    return kills


def finish(subject: Subject, limit_s: float = 60.0) -> None:
    end = time.monotonic() + limit_s
    while subject.act():
        assert time.monotonic() < end, subject.page.locator("#status").inner_text()


def asked(page: Page) -> None:
    page.locator(ASKED).first.wait_for(timeout=10_000)


def watch_errors(page: Page) -> list[str]:
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    return errors


def visible(page: Page, text: str) -> None:
    expect(page.locator("#status")).to_contain_text(text, timeout=10_000)
