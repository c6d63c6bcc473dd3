"""A study's server as a process of its own, with few descriptors, and its subject over a websocket."""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection

WHOLE = "import sys; from tactuator.cli import main; sys.exit(main())"
UNLIMITED = """
import sys
from tactuator.web import server as serving
serving.CONNECTIONS_MAX = serving.CONNECTIONS_PER_ADDRESS_MAX = serving._LOGGED_PER_MINUTE = 10**9
serving.HEADER_TIMEOUT_S, serving._BEFORE_OTHERS = 1e6, 2048
from tactuator.cli import main
sys.exit(main())
"""
"""The server without its limits, which the witness has to refuse."""
DISPLAY = """
[display]
name = "one finger"
rate_hz = 4000
delay_samples = 1
[threshold]
curve = "bolanowski-1988"
[feedback]
structure = "paper"
[[channel]]
name = "index"
finger = "index"
sensor_gain_v_per_mm = 0.19898
travel_mm = 12.5
plant = { num = [2875.0], den = [1.0, 94.0, 290.0] }
"""
PROTOCOL = """
[study]
name = "detection"
seed = 1
[procedure]
kind = "up-down"
reversals = 100000
trial_limit = 100000
averaged = 2
[conditions]
fingers = ["index"]
frequencies_hz = [100]
[timing]
lead_s = 0.0
feedback_s = 0.0
[session]
practice_trials = 0
break_after_trials = 100000
[[subject]]
code = "S1"
"""


@dataclass(frozen=True)
class Serving:
    """A server that listens. address: HOST:PORT. link: the subject's. log: what it writes to standard error."""

    address: str
    link: str
    log: Path
    process: subprocess.Popen[bytes]

    @property
    def port(self) -> int:
        return int(self.address.rpartition(":")[2])

    def descriptors(self) -> int:
        """How many descriptors the server's process holds."""
        return sum(1 for _ in Path(f"/proc/{self.process.pid}/fd").iterdir())


@contextmanager
def served(folder: Path, program: str, descriptors: int, tls: tuple[Path, Path] | None) -> Iterator[Serving]:
    """A server of a detection study on the simulated rig, as fast as it can, that may open so many descriptors."""
    (folder / "display.toml").write_text(DISPLAY, encoding="utf-8")
    (folder / "protocol.toml").write_text(PROTOCOL, encoding="utf-8")
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", program]
    subprocess.run(
        [*command, "design", "display.toml", "--out", "controller.json"],
        cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    command += ["experiment", "serve", "protocol.toml", "--store", "lab.db", "--controller", "controller.json"]
    command += ["--port", "0", "--speed", "0", "--auto-start", "--no-show"]
    if tls is not None:
        command += ["--tls-certificate", str(tls[0]), "--tls-key", str(tls[1])]
    log = folder / "log"
    with log.open("wb") as sink:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stderr=sink,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (descriptors, descriptors)),
        )  # fmt: skip
    try:
        yield _listening(process, log)
    finally:
        process.kill()
        process.wait()


def _listening(process: subprocess.Popen[bytes], log: Path) -> Serving:
    while process.poll() is None:
        if found := re.search(r"subject S1: https?://([^/]*)/s/(\S+)\n", log.read_text()):
            return Serving(found[1], found[2], log, process)
        time.sleep(0.05)
    raise RuntimeError(f"the server ended: {log.read_text()}")


class Answering:
    """The open session: a subject who answers, and how long each answer was on its way, in seconds."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        while (stage := self._until("stage")["stage"]) != "trial":
            connection.send(json.dumps({"type": "ready", "stage": stage}))
        connection.send(json.dumps({"type": "ready", "stage": "trial"}))

    def answer(self) -> float:
        """Answer the trial that stands; the seconds until the answer is acknowledged."""
        asked = self._until("answer-now")
        text = json.dumps({"type": "answer", "run": asked["run"], "number": asked["number"], "response": "1"})
        began = time.perf_counter()
        self._connection.send(text)
        self._until("ack")
        return time.perf_counter() - began

    def _until(self, kind: str) -> dict[str, Any]:
        while True:
            message: dict[str, Any] = json.loads(self._connection.recv(timeout=60.0))
            if message["type"] == kind:
                return message
