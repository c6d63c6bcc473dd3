"""The command line: processor time and memory of every --help, of a near miss and of the refusal of a missing file.

The peer is Python itself, started for nothing, and a program that imports typer and answers --help to one option: what
is above that is ours. Each command is run five times; the median is told. Bytecode is that of the installation.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from tactuator.cli.verbs import VERBS

REPEATS = 5
ALLOWED = {"help_s": 0.4, "help_goal_s": 0.15, "help_mb": 60.0, "refusal_s": 0.5, "import_s": 0.06}
PROGRAM = [sys.executable, "-m", "tactuator"]
TYPER = "import typer; typer.run(lambda level: None)"


def spent(command: list[str], folder: str) -> tuple[float, float]:
    """Return processor seconds (median) and peak memory (MB, most) of a command that is run anew each time."""
    seconds, most_mb = [], 0.0
    for _ in range(REPEATS):
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder) as process:
            _, _, used = os.wait4(process.pid, 0)
            process.returncode = 0
        seconds.append(used.ru_utime + used.ru_stime)
        most_mb = max(most_mb, used.ru_maxrss / 1024.0)
    return statistics.median(seconds), most_mb


def run() -> dict[str, object]:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "protocol.toml").touch()
        python_s, python_mb = spent([sys.executable, "-c", "pass"], folder)
        typer_s, _ = spent([sys.executable, "-c", TYPER, "--help"], folder)
        package_s, _ = spent([sys.executable, "-c", "import tactuator"], folder)
        helps = {verb or "all": spent([*PROGRAM, *verb.split(), "--help"], folder) for verb in ("", *VERBS)}
        refusals = {
            "missing record": spent([*PROGRAM, "identify", "nothing.csv"], folder),
            "missing display": spent([*PROGRAM, "design", "nothing.toml"], folder),
            "missing controller": spent([*PROGRAM, "check", "nothing.json"], folder),
            "missing speech": spent([*PROGRAM, "render", "nothing.wav", "--out", "r.wav"], folder),
            "near miss": spent([*PROGRAM, "desing"], folder),
        }
    worst_s = max(seconds for seconds, _ in helps.values())
    worst_mb = max(megabytes for _, megabytes in helps.values())
    return {
        "python": {"s": python_s, "mb": python_mb},
        "import of tactuator beyond Python": {"s": package_s - python_s, "allowed_s": ALLOWED["import_s"]},
        "--help of everything": {"s": helps["all"][0], "mb": helps["all"][1], "times_typer": helps["all"][0] / typer_s},
        "worst VERB --help": {
            "verb": max(helps, key=lambda verb: helps[verb][0]),
            "s": worst_s,
            "mb": worst_mb,
            "times_typer": worst_s / typer_s,
            "met": worst_s <= ALLOWED["help_s"] and worst_mb <= ALLOWED["help_mb"],
            "goal_met": worst_s <= ALLOWED["help_goal_s"],
        },
        "refusals": {name: seconds for name, (seconds, _) in refusals.items()}
        | {"met": max(seconds for seconds, _ in refusals.values()) <= ALLOWED["refusal_s"]},
    }
