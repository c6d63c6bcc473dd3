"""Whole commands from the shell, as a user waits for them: processor time beside a bare import in the same minute.

The unit is `python -c "import numpy, scipy.signal"`, which everything here would pay that imports what it may need.
Each command is a process of its own and they run in turn; the least of the turns counts, children included. The
console is asked by a page's own messages: its time is that of the server and its helper from the start to the answer
with the first curves of a loop. `--help` is in `bench_command_line.py`.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import soundfile
from bench_console import cores, served
from bench_experiment import filled
from timing import of_program
from websockets.sync.client import connect

from tactuator.io.shipped import EXAMPLES
from tactuator.speech.reading import sample_path

TURNS = 5
PROGRAM = [sys.executable, "-m", "tactuator"]
BARE = [sys.executable, "-c", "import numpy, scipy.signal"]
DISPLAY = EXAMPLES / "display.toml"
NAMES = """
import sys, matplotlib
matplotlib.use("Agg")
import tactuator as tt
for name in dir(tt):
    getattr(tt, name)
tt.read_controller(sys.argv[1]).plot().figure.savefig(sys.argv[2])
"""
ASKED = {
    "check": 1.0,
    "render 2 s": 0.9,
    "design, three channels": 1.8,
    "identify a minute": 2.2,
    "thresholds of 10,000 trials": 1.5,
    "all names, first figure": 2.0,
    "console, first curves": 2.0,
}


def commands(folder: Path) -> dict[str, Sequence[str]]:
    """Write what the commands read, and return them by name."""
    controller, record, speech, store = (folder / name for name in ("c.json", "r.h5", "s.wav", "s.db"))
    of_program([*PROGRAM, "design", str(DISPLAY), "--out", str(controller)])
    of_program([*PROGRAM, "record", str(DISPLAY), "--out", str(record)])
    sample, rate = soundfile.read(sample_path())
    soundfile.write(speech, np.resize(sample, 2 * rate), rate, "PCM_16")
    filled(store, 10_000)
    out = str(folder / "out")
    return {
        "check": [*PROGRAM, "check", str(controller)],
        "render 2 s": [*PROGRAM, "render", str(speech), "--controller", str(controller), "--out", f"{out}.wav"],
        "design, three channels": [*PROGRAM, "design", str(DISPLAY), "--out", f"{out}-controller.json"],
        "identify a minute": [*PROGRAM, "identify", str(record)],
        "thresholds of 10,000 trials": [*PROGRAM, "experiment", "thresholds", "--store", str(store)],
        "all names, first figure": [sys.executable, "-c", NAMES, str(controller), f"{out}.svg"],
    }


def console_s() -> float:
    """Return the processor seconds of the console until it has answered with the curves of a display's first loop."""
    with served(DISPLAY) as (address, process):
        place, _, token = address.partition("/#token=")
        with connect(re.sub("^http", "ws", place) + "/ws") as socket:
            socket.send(token)
            asked: dict[str, object] = {}
            for number, name in enumerate(("start", "bring", "draw")):
                socket.send(json.dumps({"id": number, "do": name, **asked}))
                while (answer := json.loads(socket.recv(timeout=60.0))).get("id") != number:
                    pass
                if "error" in answer:
                    raise RuntimeError(f"{name}: {answer['error']}")
                asked = {"display": "file", "channel": "index"}
                asked |= {"shape": answer["shape"]} if "shape" in answer else {}
            return sum(cores(process))


def run() -> dict[str, object]:
    with tempfile.TemporaryDirectory() as folder:
        each = commands(Path(folder))
        spent: dict[str, list[float]] = {}
        for _ in range(TURNS):
            for name, command in {"bare": BARE, **each}.items():
                spent.setdefault(name, []).append(of_program(command)[0])
            spent.setdefault("console, first curves", []).append(console_s())
    least = {name: min(times) for name, times in spent.items()}
    figures: dict[str, object] = {"bare import, s": least["bare"]}
    for name, asked in ASKED.items():
        over = least[name] / least["bare"]
        figures[name] = {"s": least[name], "over_bare_import": over, "asked": asked, "met": over <= asked}
    return figures
