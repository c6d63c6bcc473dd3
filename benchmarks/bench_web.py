"""The server's share of a trial: from an answer to its acknowledgement, and to the start of what comes next.

Each server is a process of its own: `tactuator experiment serve` on the simulated rig as fast as it can, with no
silence before the first interval and no pause for feedback, so that what is left is the server's own: the commit to
disk, the next trial from the procedure, the messages. The peers are a bare Starlette websocket that sends every message
back, and one that first commits it to SQLite as durably as the store does. The client is the same for all, in this
process; a time is one round trip as it sees it, median and 95th percentile of all trials.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import ClientConnection, connect

from tactuator.io.controller import write_controller
from tactuator.io.display import parse_display
from tactuator.speech.items import Component, WaveformSet, write_waveforms
from tactuator.synthesis.design import design_controller

TRIALS, ROUNDS = 200, 10
GOAL_MS = 20.0
PROGRAM = "import sys; from tactuator.cli import main; sys.exit(main())"
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
DETECTION = f"""
[study]
name = "detection"
seed = 1
[procedure]
kind = "up-down"
reversals = 900
averaged = 2
[conditions]
fingers = ["index"]
frequencies_hz = [100]
[timing]
lead_s = 0.0
feedback_s = 0.0
[session]
practice_trials = 0
break_after_trials = {10 * TRIALS}
[[subject]]
code = "S1"
"""
ITEMS = WaveformSet(0.5, components=(Component("M", 30.0, 40.0), Component("C", 240.0, 40.0)), fingers=(("index",),))
RECOGNITION = f"""
[study]
name = "recognition"
seed = 1
[recognition]
lead_s = 0.0
feedback_s = 0.0
[[block]]
kind = "test"
repetitions = {TRIALS}
[[subject]]
code = "S1"
""" + "".join(
    f'[[item]]\nlabel = "{label}"\nfile = "{label}.wav"\nkey = "{key}"\n' for key, label in enumerate(ITEMS.labels(), 1)
)
ECHO = """
import sqlite3, sys, uvicorn
from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from tactuator.web.server import Address
async def echo(socket):
    await socket.accept()
    while True:
        said = await socket.receive_text()
        if store is not None:
            store.execute("INSERT INTO said VALUES (?)", (said,))
        await socket.send_text(said)
store = sqlite3.connect(sys.argv[1], isolation_level=None) if len(sys.argv) > 1 else None
if store is not None:
    for line in ("PRAGMA journal_mode = WAL", "PRAGMA synchronous = FULL", "CREATE TABLE said (text)"):
        store.execute(line)
sock = Address().listen()
sys.stderr.write(f"subject S1: http://127.0.0.1:{sock.getsockname()[1]}/s/x\\n")
sys.stderr.flush()
uvicorn.Server(uvicorn.Config(Starlette(routes=[WebSocketRoute("/ws/subject/x", echo)]), log_level="error")).run([sock])
"""


@contextmanager
def subject_of(*command: str) -> Iterator[ClientConnection]:
    """A subject's connection to a server that is started for it, and ended."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, "-c", *command], stderr=subprocess.PIPE, text=True, env=environment
    ) as server:
        assert server.stderr is not None
        try:
            for line in server.stderr:
                if found := re.match(r"subject S1: http://(.*)/s/(.*)", line):
                    with connect(f"ws://{found[1]}/ws/subject/{found[2]}") as made:
                        yield made
                    return
            raise RuntimeError("the server ended before it listened")
        finally:
            server.kill()


def serve(folder: Path, protocol: str) -> list[str]:
    """The command of a server for that protocol."""
    path, store = folder / f"{protocol}.toml", folder / f"{protocol}.db"
    options = ["--controller", str(folder / "controller.json"), "--port", "0", "--speed", "0", "--auto-start"]
    return [PROGRAM, "experiment", "serve", str(path), "--store", str(store), *options]


def until(connection: ClientConnection, kind: str) -> dict[str, Any]:
    """The next message of that kind."""
    while True:
        message: dict[str, Any] = json.loads(connection.recv(timeout=30.0))
        if message["type"] == kind:
            return message


def begin(connection: ClientConnection) -> None:
    """Up to the first trial."""
    while (stage := until(connection, "stage")["stage"]) != "trial":
        connection.send(json.dumps({"type": "ready", "stage": stage}))
    connection.send(json.dumps({"type": "ready", "stage": "trial"}))


def trials(connection: ClientConnection, response: str, next_kind: str) -> list[tuple[float, float]]:
    """Milliseconds from each answer to its acknowledgement, and to the start of the next presentation."""
    times = []
    for _ in range(TRIALS // ROUNDS):
        asked = until(connection, "answer-now")
        answer = {"type": "answer", "run": asked["run"], "number": asked["number"], "response": response}
        began = time.perf_counter()
        connection.send(json.dumps(answer))
        until(connection, "ack")
        acknowledged = time.perf_counter()
        until(connection, next_kind)
        times.append((1e3 * (acknowledged - began), 1e3 * (time.perf_counter() - began)))
    return times


def round_trips(connection: ClientConnection) -> list[float]:
    """Milliseconds there and back."""
    message = json.dumps({"type": "answer", "run": 1, "number": 1, "response": "1"})
    times = []
    for _ in range(TRIALS // ROUNDS):
        began = time.perf_counter()
        connection.send(message)
        connection.recv(timeout=30.0)
        times.append(1e3 * (time.perf_counter() - began))
    return times


def figures(times: Sequence[float], peers: dict[str, float]) -> dict[str, float]:
    """Median, 95th percentile, and the median beside the peers' medians."""
    median = float(np.median(times))
    beside = {f"times_{name}": median / peer for name, peer in peers.items()}
    return {"median_ms": median, "p95_ms": float(np.percentile(times, 95.0)), **beside}


def run() -> dict[str, object]:
    """The server's share in both tasks, beside the peers."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        controller = design_controller(parse_display(tomllib.loads(DISPLAY)))
        write_controller(folder / "controller.json", controller)
        write_waveforms(ITEMS, controller, folder)
        (folder / "detection.toml").write_text(DETECTION, encoding="utf-8")
        (folder / "recognition.toml").write_text(RECOGNITION, encoding="utf-8")
        echoes = {"echo": [ECHO], "committing_echo": [ECHO, str(folder / "echo.db")]}
        tasks = {"detection": ("1", "interval"), "recognition": ("M-index", "playing")}
        with ExitStack() as stack:
            peers = {name: stack.enter_context(subject_of(*command)) for name, command in echoes.items()}
            served = {name: stack.enter_context(subject_of(*serve(folder, name))) for name in tasks}
            for connection in served.values():
                begin(connection)
            there: dict[str, list[float]] = {name: [] for name in peers}
            times: dict[str, list[tuple[float, float]]] = {name: [] for name in tasks}
            for _ in range(ROUNDS):  # in turn, so that a busy moment meets all of them
                for name, connection in peers.items():
                    there[name] += round_trips(connection)
                for name, (response, next_kind) in tasks.items():
                    times[name] += trials(served[name], response, next_kind)
    medians = {name: float(np.median(values)) for name, values in there.items()}
    result: dict[str, object] = {"trials": TRIALS, "peers_median_ms": medians}
    for name, pairs in times.items():
        acknowledged, following = zip(*pairs, strict=True)
        result[name] = {
            "answer_to_acknowledged": figures(acknowledged, medians),
            "answer_to_next_start": figures(following, medians),
        }
    return {**result, "goals": {"answer_to_next_start_ms": GOAL_MS}}
