"""Three channels for hours: streams and experiments in turn, on one rig, in one process, into one store."""

import gc
import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.presented_session import PresentedSession
from tactuator.experiment.session.studies import Study, open_session, open_study
from tactuator.experiment.session.task import Apparatus
from tactuator.experiment.store.store import Store
from tactuator.model.controller import Controller
from tactuator.rig.simulated import SimulatedRig
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, token

STREAM_S, BLOCK_S = 720.0, 0.05
PROBE_HZ, HOURS = 90.0, 24.0


def blocks(rng: np.random.Generator, seconds: float, rate_hz: float, channels: int) -> Iterator[np.ndarray]:
    """Noise at the level of speech, with pauses."""
    for _ in range(round(seconds / BLOCK_S)):
        yield (30.0 if rng.random() < 0.7 else 0.0) * rng.standard_normal((round(BLOCK_S * rate_hz), channels))


def whole_session(study: Study, clock: ObedientClock, code: str) -> int:
    """Go through a session of a subject; how many trials it had."""
    session = open_session(study, code)
    session.give_consent()
    presented, trials = PresentedSession(session), 0
    while session.stage != "done":
        if session.stage == "break":
            clock.wait(100.0)
            session.end_break()
        elif session.stage == "introduction":
            session.introduce()
        else:
            answer_one(presented, clock)
            trials += 1
    return trials


def probed_db(rig: SimulatedRig) -> np.ndarray:
    """What each channel makes of the same tone from rest."""
    time_s = np.arange(round(rig.rate_hz)) / rig.rate_hz
    rig.rest()
    trace = rig.play(np.repeat(100.0 * np.sin(2.0 * np.pi * PROBE_HZ * time_s)[:, None], len(rig.channels), axis=1))
    rig.rest()
    late = trace.position_v[len(time_s) // 2 :]
    return 20.0 * np.log10(np.std(late, axis=0))


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") / 1e6


@pytest.mark.soak
def test_day__of_three_channels_with_experiments_and_streams__memory_and_state_are_flat(
    tmp_path: Path, controller: Controller
) -> None:
    rig, clock, rng = SimulatedRig(controller.display, 7), ObedientClock(), np.random.default_rng(3)
    rig.load(controller)
    text = PROTOCOL[: PROTOCOL.index("[[subject]]")].replace(
        '"index"', json.dumps(controller.display.channels[0].finger)
    )
    text += "".join(f'[[subject]]\ncode = "D{number}"\n' for number in range(140))
    store = Store(tmp_path / "lab.db")
    task = DetectionTask(parse_protocol(text), Apparatus(rig, controller, "simulated"))
    study = open_study(store, task, text, clock, token, None)
    played_s, quarter, memory, levels, objects = 0.0, 0, [], [], []
    while played_s < HOURS * 3600.0:
        for trace in rig.stream(blocks(rng, STREAM_S, rig.rate_hz, len(rig.channels))):
            played_s += len(trace.position_v) / rig.rate_hz
        played_s += whole_session(study, clock, f"D{quarter}")
        levels.append(probed_db(rig))
        gc.collect()
        memory.append(resident_mb())
        objects.append(len(gc.get_objects()))
        quarter += 1
    store.close()
    first = max(quarter // 10, 1)
    assert memory[-1] - memory[first] < 10.0
    assert objects[-1] - objects[first] < 2000
    assert np.ptp(levels, axis=0).max() < 0.1
