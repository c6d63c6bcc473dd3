"""What `identify` says of motors whose friction its model does not have: on springs, and free ones in position loops.

The motors are drawn and simulated by motors.py, which is NumPy alone. Of motors on springs (--sprung) the intervals of
95 % hold mass, viscous damping and Coulomb level: at least as many as chance leaves in 999 of 1000 cases. A free motor
that friction rules in a position loop cannot be identified: a model is wrong where it is trusted and departs from the
motor by more than its band and 0.1 dB where it calls itself valid.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from scipy import stats

from tactuator.errors import BadInput
from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.signals.record import Record
from witnesses.identification.motors import RATE_HZ, Motors, Values, drawn, recorded

NAMES = ("mass", "viscous", "Coulomb")
MATERIAL_DB = 0.1


def said(found: Identification) -> tuple[Values, Values]:
    """Return mass, viscous damping and Coulomb level of a model of forces and positions, and their half-widths."""
    assert found.friction is not None
    assert found.mass_and_viscous is not None
    rows = np.array([*found.mass_and_viscous, (found.friction.coulomb, found.friction.confidence)])
    return rows[:, 0], rows[:, 1]


def sprung_hold(motors: Motors, records: list[Record]) -> bool:
    """Print truth, estimate and interval of every constant; tell whether as many hold as should."""
    print(f"{'':24}{'truth':>12}{'estimate':>12}{'±':>10}{'off %':>8}{'± %':>7}")
    held = []
    for k, record in enumerate(records):
        found = identify(record)
        if found.mass_and_viscous is None or found.friction is None:
            print(f"motor {k + 1}: {found.order} poles, {found.model.num.size - 1} zeros, or no friction: not counted")
            continue
        truth = (motors.mass[k], motors.viscous[k], motors.coulomb[k])
        for what, value, own, half in zip(NAMES, truth, *said(found), strict=True):
            held.append(abs(own - value) <= half)
            off, wide = 100.0 * (own / value - 1.0), 100.0 * half / value
            inside = "" if held[-1] else "  outside"
            print(f"motor {k + 1:6}{what:12}{value:12.5g}{own:12.5g}{half:10.2g}{off:8.2f}{wide:7.2f}{inside}")
    least = int(stats.binom.ppf(1e-3, len(held), 0.95))
    print(f"{sum(held)} of {len(held)} intervals hold ({least} must)")
    return bool(held) and sum(held) >= least


def free_told(motors: Motors, records: list[Record]) -> bool:
    """Print the status of every motor; tell whether none is trusted and wrong."""
    wrong = 0
    for k, record in enumerate(records):
        try:
            found = identify(record)
        except BadInput as refusal:
            print(f"motor {k + 1:3} status 2: {refusal}", flush=True)
            continue
        hertz = np.geomspace(*(found.model.valid_hz or found.model.band_hz), 200)
        s = 2j * np.pi * hertz
        off = np.abs(found.model.response(hertz) * (motors.mass[k] * s**2 + motors.viscous[k] * s))
        beyond = float(np.max(np.abs(20.0 * np.log10(off)) - found.model.band_db(hertz)))
        is_wrong = not found.distrust and beyond > MATERIAL_DB
        wrong += is_wrong
        status = "WRONG" if is_wrong else f"status {int(bool(found.distrust))}"
        print(f"motor {k + 1:3} {status}: {'; '.join(found.distrust)}", flush=True)
    print(f"{wrong} of {len(records)} trusted and wrong")
    return wrong == 0


def main() -> int:
    """Print a table; return 0 where the claim holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="motors")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sprung", action="store_true", help="motors that a spring holds, in no loop")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    motors = drawn(rng, given.count, sprung=given.sprung)
    forces, positions = recorded(motors, rng)
    records = [Record(RATE_HZ, force, place) for force, place in zip(forces.T, positions.T, strict=True)]
    return int(not (sprung_hold if given.sprung else free_told)(motors, records))


if __name__ == "__main__":
    sys.exit(main())
