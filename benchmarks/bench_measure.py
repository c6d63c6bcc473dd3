"""Stepped sine of 90 frequencies on a simulated channel, beside least squares block by block.

The peer plays the same blocks on the same display and fits the same lines to each by `numpy.linalg.lstsq`, eight blocks
a frequency; it settles for as long, and has no confidence, no distortion, no growing number of blocks.
"""

from __future__ import annotations

import numpy as np
from paper_loop import RATE_HZ, paper_controller, paper_display
from timing import in_turn

from tactuator.measure.options import MeasurementOptions
from tactuator.measure.response import stepped_sine
from tactuator.rig.simulated import SimulatedRig
from tactuator.signals.decibels import from_db
from tactuator.signals.multisine import tones
from tactuator.signals.spectra import mains_multiples, off_mains

LEVEL_DB_SL, POINTS, BLOCKS = 20.0, 90, 8


def rig() -> SimulatedRig:
    display = paper_display()
    made = SimulatedRig(display, seed=1)
    made.load(paper_controller(display))
    return made


def peer(own: SimulatedRig, frequency_hz: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[complex]:
    found = []
    for hertz in frequency_hz:
        lines = np.concatenate([hertz * np.arange(1.0, 4.0), mains_multiples(60.0, 420.0)])
        block = round(np.ceil(0.25 * hertz) / hertz * RATE_HZ)
        settle = round(max(0.5, 1.25 / hertz) * RATE_HZ)
        time_s = np.arange(settle + BLOCKS * block) / RATE_HZ
        wave = float(from_db(LEVEL_DB_SL)) * np.sin(2.0 * np.pi * hertz * time_s)
        position = own.play(wave[:, None]).position_v[settle:, 0]
        each = []
        for first in range(0, BLOCKS * block, block):
            angle = 2.0 * np.pi * np.outer(time_s[settle + first : settle + first + block], lines)
            columns = np.hstack([np.cos(angle), -np.sin(angle), np.ones((block, 1))])
            fit = np.linalg.lstsq(columns, position[first : first + block], rcond=None)[0]
            each.append(complex(fit[0], fit[lines.size]))
        found.append(complex(np.mean(each)))
    return found


OPTIONS = MeasurementOptions(LEVEL_DB_SL)


def run() -> dict[str, object]:
    own = rig()
    asked = tones(off_mains(np.geomspace(1.0, 290.0, POINTS)), 60.0, (0.0, 0.45 * RATE_HZ))
    spent = in_turn({"own": lambda: stepped_sine(own, asked, OPTIONS), "least squares": lambda: peer(own, asked)})
    measured = stepped_sine(own, asked, OPTIONS)[0].amplitude_v
    theirs = 1j * np.array(peer(own, asked))
    return {
        "own_s": spent["own"],
        "least_squares_s": spent["least squares"],
        "over_peer": spent["own"] / spent["least squares"],
        "largest_difference_db": float(np.max(np.abs(20.0 * np.log10(np.abs(measured / theirs))))),
        "goal_s": 0.25,
    }
