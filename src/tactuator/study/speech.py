"""Step 12: speech, band-limited to 300 Hz, as the reference of every finger; felt against asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.digital.controller import Controller
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.decibels import from_db
from tactuator.speech.direct import DirectCoding
from tactuator.speech.felt import FeltComparison, FeltReport
from tactuator.speech.level import LevelMeter
from tactuator.speech.reading import SpeechFile, scan_speech, speech_blocks
from tactuator.speech.synthesis import sample_path
from tactuator.study.plan import Plan, Progress

LEVEL_DB_SL = 35.0
_BLOCK = 40_000
_TAIL_S = 0.5


@dataclass(frozen=True)
class Spoken:
    """file: what was presented, gain: threshold units per unit of the file, report: felt against asked."""

    file: SpeechFile
    gain: float
    report: FeltReport
    saturated: bool


def check_speech(plan: Plan) -> SpeechFile:
    """The plan's speech file, read through. Raises BadInput for one that cannot be used: ask before all else is run."""
    return scan_speech(sample_path() if plan.speech is None else plan.speech)


def speak(plan: Plan, controller: Controller, file: SpeechFile, progress: Progress) -> Spoken:
    """The file at LEVEL_DB_SL on all channels of the simulated display, untouched, felt at the finger ports."""
    signal, gain = _reference(file, round(controller.rate_hz))
    rig = SimulatedRig(controller.display, plan.seed_of("speech"))
    rig.load(controller)
    felt: dict[str, list[NDArray[np.float64]]] = {name: [] for name in rig.channels}
    for name, blocks in felt.items():
        rig.finger(name).attach(blocks.append)
    comparison, saturated = FeltComparison(controller), False
    for start in range(0, signal.size, _BLOCK):
        reference = np.repeat(signal[start : start + _BLOCK, None], len(rig.channels), axis=1)
        saturated |= bool(rig.play(reference).saturated.any())
        comparison.push(reference, np.stack([blocks.pop() for blocks in felt.values()], axis=1))
        progress("speech", min(1.0, (start + _BLOCK) / signal.size))
    return Spoken(file, gain, comparison.finish(), saturated)


def _reference(file: SpeechFile, rate_hz: int) -> tuple[NDArray[np.float64], float]:
    """The band-limited signal in threshold units at LEVEL_DB_SL, a moment of silence after it; and the gain used."""
    blocks = DirectCoding().signals(speech_blocks(file), file.rate_hz, rate_hz)
    coded = np.concatenate([block[:, 0] for block in blocks])
    meter = LevelMeter(rate_hz)
    meter.push(coded[:, None])
    gain = float(from_db(LEVEL_DB_SL - meter.level_db()))
    return np.append(gain * coded, np.zeros(round(_TAIL_S * rate_hz))), gain
