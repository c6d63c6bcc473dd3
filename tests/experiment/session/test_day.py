"""Three channels for hours: streams and experiments in turn, on one rig, in one process, into one store."""

import gc
import json
from contextlib import closing

import numpy as np
import psutil
import pytest

from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.presented_session import PresentedSession
from tactuator.experiment.session.studies import open_session, open_study
from tactuator.experiment.session.task import Apparatus
from tactuator.experiment.store.store import Store
from tactuator.rig.simulated import SimulatedRig
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, everything, token

PARTS, STREAM_S, BLOCK = 100, 720.0, 200


@pytest.mark.soak
def test_day__of_three_channels_with_experiments_and_streams__memory_and_state_are_flat(tmp_path, controller) -> None:
    rig, clock, rng = SimulatedRig(controller.display, 7), ObedientClock(), np.random.default_rng(3)
    rig.load(controller)
    finger = json.dumps(controller.display.channels[0].finger)
    text = PROTOCOL[: PROTOCOL.index("[[subject]]")].replace('"index"', finger)
    text += "".join(f'[[subject]]\ncode = "D{part}"\n' for part in range(PARTS))
    time_s = np.arange(round(rig.rate_hz))[:, None] / rig.rate_hz
    tone = np.repeat(100.0 * np.sin(2.0 * np.pi * 90.0 * time_s), len(rig.channels), axis=1)
    memory_mb, objects, levels_db = [], [], []
    with closing(Store(tmp_path / "lab.db")) as store:
        task = DetectionTask(parse_protocol(text), Apparatus(rig, controller, "simulated"))
        study = open_study(store, task, text, clock, token, None)
        for part in range(PARTS):
            loud = rng.choice([30.0, 30.0, 0.0], round(STREAM_S * rig.rate_hz / BLOCK))  # as speech, with pauses
            for _ in rig.stream(level * rng.standard_normal((BLOCK, len(rig.channels))) for level in loud):
                pass
            session = open_session(study, f"D{part}")
            session.give_consent()
            everything(PresentedSession(session), clock)
            rig.rest()
            levels_db.append(20.0 * np.log10(np.std(rig.play(tone).position_v[len(tone) // 2 :], axis=0)))
            rig.rest()
            gc.collect()
            memory_mb.append(psutil.Process().memory_info().rss / 1e6)
            objects.append(len(gc.get_objects()))
    assert memory_mb[-1] - memory_mb[PARTS // 10] < 10.0
    assert objects[-1] - objects[PARTS // 10] < 2000
    assert np.ptp(levels_db, axis=0).max() < 0.1
