"""The command line: processor time and memory of every --help, of a near miss and of the refusal of a missing file.

The peer is Python itself, started for nothing, and a program that imports typer and answers --help to one option: what
is above that is ours. Each command is run five times; the median is told. Bytecode is that of the installation.

The longest command is `reproduce`: its elapsed seconds, and processor seconds of its parts. The observers' processes
are started by a server, and nobody is told what they took: they sit once more in this process. The peer is what cannot
be left out: the loops of their sittings, where the simulation plays as many samples in blocks of 4 s and nothing else
is done.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import ArrayLike
from timing import in_turn, of_program

import tactuator
from tactuator.api.parameters import paper_controller, paper_display
from tactuator.cli.commands import top_commands
from tactuator.io.controller import write_controller
from tactuator.model.controller import Controller
from tactuator.paper.lab import CONTROLLER
from tactuator.paper.people import run_subject, write_protocols
from tactuator.paper.plan import PEOPLE, Plan
from tactuator.rig.rig import Trace
from tactuator.rig.simulated import SimulatedRig

REPEATS = 5
ALLOWED = {"help_s": 0.4, "help_goal_s": 0.15, "help_mb": 60.0, "refusal_s": 0.5, "import_s": 0.06}
PROGRAM = [sys.executable, "-m", "tactuator"]
TYPER = "import typer; typer.run(lambda level: None)"
REPRODUCE_GOAL_S = 7.0
BLOCK = 16_000


def spent(command: list[str], ends: int = 0) -> tuple[float, float]:
    """Return processor seconds (median) and peak memory (MB, most) of a command that is run anew each time."""
    runs = [of_program(command, [ends]) for _ in range(REPEATS)]
    return statistics.median(cpu_s for cpu_s, _, _ in runs), max(peak_mb for _, _, peak_mb in runs)


class CountedRig(SimulatedRig):
    """A simulated display; `played` counts the samples that all of them play."""

    played = 0

    def play(self, reference: ArrayLike) -> Trace:
        trace = super().play(reference)
        CountedRig.played += len(trace)
        return trace


def sittings(plan: Plan, controller: Controller) -> None:
    """Let the subjects sit one after the other."""
    with tempfile.TemporaryDirectory() as folder, patch.object(tactuator, "SimulatedRig", CountedRig):
        place = Path(folder)
        write_protocols(plan, place)
        write_controller(place / CONTROLLER, controller)
        for name in PEOPLE:
            run_subject(plan, place, name, place / f"{name}.db")


def bare_loops(controller: Controller, samples: int) -> None:
    """Play as many samples of silence."""
    rig = SimulatedRig(controller.display, 0)
    rig.load(controller)
    block = np.zeros((BLOCK, len(controller.channels)))
    for _ in range(round(samples / BLOCK)):
        rig.play(block)


def reproduced() -> dict[str, float]:
    """Return the figures of `reproduce`."""
    plan = Plan(paper_display())
    controller = paper_controller(plan.display)
    with tempfile.TemporaryDirectory() as folder:
        command = [*PROGRAM, "reproduce", "--out", str(Path(folder) / "paper")]
        cpu_s, elapsed_s, _ = of_program(command)
    sitting_s = in_turn({"all": lambda: sittings(plan, controller)}, 1)["all"]
    loops_s = in_turn({"all": lambda: bare_loops(controller, CountedRig.played)}, 2)["all"]
    return {
        "elapsed_s": elapsed_s,
        "observers_s": sitting_s,
        "all_else_s": cpu_s,
        "bare_loops_s": loops_s,
        "processor_over_bare_loops": (sitting_s + cpu_s) / loops_s,
        "million_samples": CountedRig.played / 1e6,
        "goal_elapsed_s": REPRODUCE_GOAL_S,
    }


def run() -> dict[str, object]:
    python_s, python_mb = spent([sys.executable, "-c", "pass"])
    typer_s, _ = spent([sys.executable, "-c", TYPER, "--help"])
    package_s, _ = spent([sys.executable, "-c", "import tactuator"])
    helps = {verb or "all": spent([*PROGRAM, *verb.split(), "--help"]) for verb in ("", *top_commands())}
    refusals = {
        "missing record": spent([*PROGRAM, "identify", "nothing.csv"], 2),
        "missing display": spent([*PROGRAM, "design", "nothing.toml"], 2),
        "missing controller": spent([*PROGRAM, "check", "nothing.json"], 2),
        "missing speech": spent([*PROGRAM, "render", "nothing.wav", "--out", "r.wav"], 2),
        "near miss": spent([*PROGRAM, "desing"], 2),
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
        "reproduce": reproduced(),
    }
