"""A detection experiment and a speech file on a simulated sound card, from start to end: JSON.

The subject is a script that detects by Weibull's function of the level at which the trial was really felt: the
exciter's displacement, in its own port of the card, which the display has as its sensor here.
"""

import json
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from sqlalchemy import select

from tactuator.cli import main
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.session.presented_session import PresentedSession, Respondent, run_session
from tactuator.experiment.session.studies import open_session, open_study
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import PlayedTrial
from tactuator.experiment.store.store import Store
from tactuator.experiment.trial import Trial
from tactuator.io.controller import write_controller
from tactuator.io.display import parse_display
from tactuator.io.shipped import EXAMPLES
from tactuator.model.controller import Controller
from tactuator.rig.open import open_rig
from tactuator.rig.sound.cards import measure_delay, wire_display
from tactuator.rig.sound.rig import SoundRig
from tactuator.rig.sound.simulated_card import Exciter, simulated_card
from tactuator.synthesis.design import design_controller
from tests.experiment.session.apparatuses import token

RATE_HZ = 48000.0
TRUE_DB_SL = 6.0
EXCITER = Exciter(resonance_hz=90.0, q=4.0, drive=3e4, second_share=0.0, delay_s=0.003, noise=0.0, hum=0.0)
PROTOCOL = """
[study]
name = "card"
seed = 3
experimenter = "EX"
consent = ""
[procedure]
kind = "up-down"
start_db_sl = 26
steps_db = [4, 2]
reversals = 8
averaged = 6
[conditions]
fingers = ["index"]
frequencies_hz = [140]
[timing]
stimulus_s = 0.3
ramp_s = 0.05
gap_s = 0.1
lead_s = 0.3
feedback_s = 0.0
[session]
practice_trials = 0
[[subject]]
code = "S1"
group = "hearing"
"""


def controller(latency_samples: int) -> Controller:
    """Designed for the exciter's own equations, with its displacement as the sensor."""
    w = 2.0 * np.pi * EXCITER.resonance_hz
    plant = {"num": [EXCITER.drive], "den": [1.0, w / EXCITER.q, w * w], "delay_s": EXCITER.delay_s}
    return design_controller(
        parse_display(
            {
                "display": {"name": "exciter", "rate_hz": RATE_HZ, "delay_samples": 0},
                "threshold": {"curve": "bolanowski-1988", "band_hz": [40.0, 300.0]},
                "feedback": {"structure": "none"},
                "converter": {"range_v": EXCITER.volts},
                "prefilter": {"poles": 8},
                "sound": {
                    "output_full_scale_v": EXCITER.volts,
                    "input_full_scale_v": EXCITER.felt_full_scale_mm,
                    "lead_s": 2.0,
                    "latency_samples": latency_samples,
                },
                "channel": [
                    {"name": "index", "finger": "index", "input": 3, "sensor_gain_v_per_mm": 1.0, "travel_mm": 1.0,
                     "plant": plant}
                ],
            }
        )
    )  # fmt: skip


class Scripted(Respondent):
    """Detects what was felt, with a slope of 2.5, one of three when it does not."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.felt_db_sl, self.asked_db_sl = rng, [], []

    def presented(self, played: PlayedTrial) -> None:
        (signal,) = [one for one in played.intervals if one.commanded_db_sl is not None]
        self.asked_db_sl.append(signal.commanded_db_sl)
        self.felt_db_sl.append(signal.measured_db_sl)

    def respond(self, trial: Trial) -> str:
        above = 10.0 ** ((self.felt_db_sl[-1] - TRUE_DB_SL) / 20.0)
        if self.rng.random() < 1.0 - np.exp(-np.log(3.2) * above**2.5):
            return trial.correct
        return str(self.rng.choice(trial.responses))


def detection(card: str, made: Controller, folder: Path) -> dict[str, object]:
    """Run the study on the card and tell its threshold, and how far what was felt stood off what was asked."""
    subject = Scripted(np.random.default_rng(5))
    store = Store(folder / "lab.db")
    with open_rig(f"sound:{card}", made.display) as rig:
        assert isinstance(rig, SoundRig)
        rig.load(made)
        task = DetectionTask(parse_protocol(PROTOCOL), Apparatus(rig, made, f"sound:{card}"))
        study = open_study(store, task, PROTOCOL, SystemClock(), token, None)
        trials = run_session(PresentedSession(open_session(study, "S1")), subject)
    with store.read() as connection:
        runs = list(connection.execute(select(schema.run)))
        ticks = [row.rig_tick for row in connection.execute(select(schema.trial))]
        missed = [row.detail for row in connection.execute(select(schema.event)) if row.kind == "timing-missed"]
    store.close()
    assert main(["experiment", "thresholds", "--store", str(folder / "lab.db"), "--json"]) in (0, 1)
    loud = [f - a for f, a in zip(subject.felt_db_sl, subject.asked_db_sl, strict=True) if a > 6.0]
    return {
        "trials": trials,
        "answered": len(ticks),
        "runs": [row.state for row in runs],
        "ticks_ascend": bool(np.all(np.diff(ticks) > 0)),
        "missed": missed,
        "felt_off_db": float(np.max(np.abs(loud))),
    }


def speech(card: str, made: Controller, folder: Path) -> dict[str, object]:
    """Render the example's speech and play it on the card by the commands."""
    write_controller(folder / "controller.json", made)
    common = ["--controller", str(folder / "controller.json"), "--json"]
    rendered = main(
        ["render", str(EXAMPLES / "speech.wav"), "--out", str(folder / "speech.h5"), "--level", "30", *common]
    )
    played = main(["play", str(folder / "speech.h5"), "--rig", f"sound:{card}", *common])
    return {"rendered": rendered, "played": played}


def run() -> dict[str, object]:
    began = datetime.now(UTC)
    with tempfile.TemporaryDirectory() as name, simulated_card([EXCITER, None]) as card:
        folder = Path(name)
        # the wire beside the exciter, as `sound latency` hears it
        with open_rig(f"sound:{card.device}", wire_display(RATE_HZ, 2, 2)) as wire:
            assert isinstance(wire, SoundRig)
            wire.feed_far_ahead()
            late = measure_delay(wire, 0.1, np.random.default_rng(0))
        made = controller(late.samples)
        found = {"latency_samples": late.samples, "spread": late.spread}
        found |= detection(card.device, made, folder) | speech(card.device, made, folder)
    return found | {"s": (datetime.now(UTC) - began).total_seconds()}


if __name__ == "__main__":
    found = run()
    sys.stdout.write(json.dumps(found) + "\n")
