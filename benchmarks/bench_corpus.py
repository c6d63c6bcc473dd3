"""A corpus of 4 s files, beside the same speech as one long file; and two workers beside one.

Rates are seconds of speech for each second of this process, which does the tasks itself, journal and manifest included.
The gain of the second worker is of elapsed time, without what it takes to begin, and means something on two free cores
alone: the load is told.
"""

from __future__ import annotations

import itertools
import os
import tempfile
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import soundfile
from bench_speech import DISPLAY
from timing import in_turn

from tactuator.corpus.corpus import run_corpus
from tactuator.corpus.workers import Here, LocalProcesses, Workers
from tactuator.io.display import parse_display
from tactuator.speech.coding import coding_of
from tactuator.speech.reading import sample_path
from tactuator.speech.render import RenderJob
from tactuator.synthesis.design import design_controller

FILES, FILE_S = 150, 4.0
GOALS = {"plain": 2500.0, "felt": 1000.0}


def speech(folder: Path) -> None:
    """Write FILES files of FILE_S seconds, the same as one long one, and two of them alone."""
    sample, rate = soundfile.read(sample_path())
    count, rng = round(FILE_S * rate), np.random.default_rng(0)
    for name in ("short", "long", "two"):
        (folder / name).mkdir()
    whole = []
    for number in range(FILES):
        piece = np.roll(np.resize(sample, count), int(rng.integers(count))) * rng.uniform(0.5, 1.0)
        whole.append(piece)
        for name in ("short", "two") if number < 2 else ("short",):
            soundfile.write(folder / name / f"{number:04d}.wav", piece, rate, "PCM_16")
    soundfile.write(folder / "long" / "all.wav", np.concatenate(whole), rate, "PCM_16")


def run() -> dict[str, object]:
    controller = design_controller(parse_display(tomllib.loads(DISPLAY)))
    figures: dict[str, object] = {"files": FILES, "file_s": FILE_S}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        speech(folder)

        outs = (folder / f"out{number}" for number in itertools.count())

        def corpus(of: str, workers: Workers, job: RenderJob) -> Callable[[], None]:
            def work() -> None:
                run_corpus(folder / of, next(outs), job, workers)  # to remove what is there takes time, and to reuse it

            return work

        def elapsed_s(workers: int, job: RenderJob) -> float:
            spent = {}
            for of in ("two", "short"):
                begun = time.perf_counter()
                corpus(of, LocalProcesses(workers), job)()
                spent[of] = time.perf_counter() - begun
            return spent["short"] - spent["two"]

        for kind, goal in GOALS.items():
            job = RenderJob(controller, coding_of("direct"), simulate=kind == "felt")
            spent = in_turn({of: corpus(of, Here(), job) for of in ("short", "long")}, 2)
            load = os.getloadavg()[0]
            turns = [(elapsed_s(1, job), elapsed_s(2, job)) for _ in range(2)]
            one_s, two_s = (min(turn[which] for turn in turns) for which in (0, 1))
            figures[kind] = {
                **{f"{of}_times_real_time": FILES * FILE_S / each for of, each in spent.items()},
                "short_over_long": spent["short"] / spent["long"],
                "second_worker_gain": one_s / two_s,
                "load": load,
                "goal_times_real_time": goal,
            }
    return figures
