"""The whole loop closed: a person with a law of its own matches tones, contours are made, a display follows them.

Tones of equal reference, 20, 30 and 40 dB SL, are then as strong as the display's own tone of 100 Hz within 1.5 dB,
for that person, free and under the designed finger, at frequencies that were matched and between them. The person
(person.py) judges the displacement at the finger port by a law that the design never sees; all it hands over are noisy
matches. Seen to fail with --equal-sl: without contours the same person is up to 8 dB off.

The contours are the matches, smoothed over levels and frequencies; with --estimated, which takes half the trials, those
that the experiment's estimate finds over all laws by their evidence.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.experiment.strength.estimate import estimate
from tactuator.experiment.strength.matches import ContourSetting, Matches
from tactuator.io.csv_tables import read_contours, write_contours
from tactuator.model.controller import Controller
from tactuator.model.description import Display, Strength
from tactuator.paper.run import default_display
from tactuator.perception.contours import Contours
from tactuator.rig.simulated import SimulatedRig
from tactuator.synthesis.design import design_controller
from witnesses.strength.person import Answer, Person, answered, matched
from witnesses.touch import felt

MATCHED_HZ = np.array([3.0, 6.0, 11.0, 18.0, 30.0, 45.0, 65.0, 100.0, 150.0, 205.0, 250.0, 300.0])
MATCHED_DB_SL = np.array([10.0, 17.0, 24.0, 31.0, 38.0, 45.0])
TONES_HZ = (4.0, 8.0, 14.0, 22.0, 30.0, 38.0, 55.0, 80.0, 125.0, 175.0, 225.0, 250.0, 290.0)
LEVELS_DB_SL, MOST_DB = (20.0, 30.0, 40.0), 1.5
_STANDARD_HZ = 100.0
CONTOURS_DB_SL = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0)
CONTOURS_HZ = np.geomspace(3.0, 300.0, 17)
_NEAR_DECADES, _NEAR_DB = 0.1, 8.0
_SETTLING_S, _LISTENED_S = 4.0, 1.0


def contours_of(person: Person, trials: int) -> Contours:
    """Return contours from the person's matches, smoothed by a Gaussian over log frequency and level."""
    moved = np.zeros((MATCHED_DB_SL.size, MATCHED_HZ.size))
    for row, level in enumerate(MATCHED_DB_SL.tolist()):
        for column, hertz in enumerate(MATCHED_HZ.tolist()):
            if hertz != _STANDARD_HZ:
                moved[row, column] = matched(person, hertz, level, trials) - level
    along = np.log10(MATCHED_HZ)
    near_hz = np.exp(-0.5 * ((along[:, None] - along) / _NEAR_DECADES) ** 2)
    near_db = np.exp(-0.5 * ((MATCHED_DB_SL[:, None] - MATCHED_DB_SL) / _NEAR_DB) ** 2)
    near_hz, near_db = near_hz / near_hz.sum(axis=1)[:, None], near_db / near_db.sum(axis=1)[:, None]
    smooth = near_db @ moved @ near_hz.T
    smooth -= smooth[:, MATCHED_HZ == _STANDARD_HZ]
    level = np.maximum.accumulate(MATCHED_DB_SL[:, None] + smooth + 1e-3 * np.arange(MATCHED_DB_SL.size)[:, None])
    return Contours("the person's", MATCHED_HZ, MATCHED_DB_SL, level, provenance="simulated", source="noisy matches")


def estimated_contours(person: Person, trials: int) -> Contours:
    """Return contours from the person's matches, as `experiment contours` finds them: over all laws by evidence."""
    rows: list[Answer] = []
    for level in MATCHED_DB_SL.tolist():
        for hertz in MATCHED_HZ[MATCHED_HZ != _STANDARD_HZ].tolist():
            rows += answered(person, hertz, level, trials)
    estimated = estimate(Matches.of(rows), ContourSetting(_STANDARD_HZ, (3.0, 300.0)))
    order = f"order bias {estimated.order_db.value:.2f} dB (put in: {person.order_db:g})"
    print(f"{len(rows)} matches; law: {estimated.law}; {order}")
    level = np.array(CONTOURS_DB_SL)
    centre, low, high = estimated.contours(CONTOURS_HZ, level)
    return Contours("the person's", CONTOURS_HZ, level, centre, low, high, provenance="simulated", source="matches")


def strengths(
    display: Display, controller: Controller, person: Person, level_db_sl: float, load: str | None
) -> FloatArray:
    """Return how much stronger than the display's 100 Hz each tone of one reference is, (tones, channels)."""
    time_s = np.arange(round((_SETTLING_S + _LISTENED_S) * display.rate_hz)) / display.rate_hz
    rows = []
    for hertz in (_STANDARD_HZ, *TONES_HZ):
        rig = SimulatedRig(display, seed=7)
        rig.load(controller)
        moved: list[list[FloatArray]] = [[] for _ in display.channels]
        for place, channel in enumerate(display.channels):
            port = rig.finger(channel.name)
            port.touch(load)
            port.attach(moved[place].append)
        wave = 10.0 ** (level_db_sl / 20.0) * np.sin(2.0 * np.pi * hertz * time_s)
        rig.play(np.repeat(wave[:, None], len(display.channels), axis=1))
        part = slice(-round(_LISTENED_S * display.rate_hz), None)
        turned = np.exp(-2j * np.pi * hertz * time_s[part])
        peaks = [2.0 * abs(np.mean(np.concatenate(each).ravel()[part] * turned)) for each in moved]
        rows.append([person.strength(hertz, 20.0 * np.log10(1e3 * peak)) for peak in peaks])
    table = np.array(rows)
    return np.asarray(table[1:] - table[0])


def main() -> int:
    """Print the worst strength of each level, free and touched; return 0 where all are kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--trials", type=int, default=40, help="of each match")
    parser.add_argument("--estimated", action="store_true", help="contours over all laws by their evidence")
    parser.add_argument("--equal-sl", action="store_true", help="without contours: seen to fail")
    parser.add_argument("--one-level", type=float, help="the prefilter of one strength level in place of all")
    given = parser.parse_args()
    person, display = Person(np.random.default_rng(given.seed)), default_display(felt.example())
    contours_by = estimated_contours if given.estimated else contours_of
    if not given.equal_sl:
        with tempfile.TemporaryDirectory() as folder:
            write_contours(Path(folder) / "contours.csv", contours_by(person, given.trials))
            contours = read_contours(Path(folder) / "contours.csv")
        strength = Strength(contours, blended=True)
        if given.one_level is not None:
            strength = Strength(contours, given.one_level)
        display = replace(display, channels=tuple(replace(one, strength=strength) for one in display.channels))
        true = [person.strength(hertz, person.threshold_db(hertz) + float(contours.level_db_sl_at(30.0, hertz))) - 30.0
                for hertz in TONES_HZ]  # fmt: skip
        print(f"the contour of 30 dB SL is off the person's law by {np.max(np.abs(true)):.2f} dB at most")
    controller = design_controller(display)
    kept = []
    for level in LEVELS_DB_SL:
        for load in (None, "finger"):
            off = strengths(display, controller, person, level, load)
            worst = np.unravel_index(np.argmax(np.abs(off)), off.shape)
            where = f"{level:g} dB SL, {load or 'free'}, worst at {TONES_HZ[int(worst[0])]:g} Hz"
            kept.append(felt.verdict(f"stronger than 100 Hz at {where}", float(np.abs(off[worst])), MOST_DB))
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
