"""Fingers drawn anew: 95 % felt within 1 dB, all within 1.5 dB; Kelvin-Voigt chains of two masses within 1.5 dB.

Each figure of a finger is 0.5 to 1.5 times the designed one, drawn uniformly; each has twelve tones, drawn evenly in
log frequency from 0.4 to 298 Hz at 20, 30, 40 and 50 dB SL. Of a chain the contact's figures are drawn and the two
masses are together 0.5 to 1.5 times the designed; the estimator does not contain it. The device is generator.c, which
shares nothing with core's simulated display. Seen to fail with --fixed.
"""

from __future__ import annotations

import sys

import numpy as np

from tactuator.model.controller import ChannelController
from witnesses.touch import felt
from witnesses.touch.device import Device

LEVELS_DB_SL = (20.0, 30.0, 40.0, 50.0)
TONES = 12
SETTLING_S = 3.0
MAINS_HZ, AWAY_HZ = 60.0, 2.0


def one_mass(rng: np.random.Generator, place: int) -> tuple[float, ...]:
    """Return a finger of 0.5 to 1.5 times the designed figures."""
    return tuple(rng.uniform(0.5, 1.5) * np.array(felt.nominal(place)))


def two_masses(rng: np.random.Generator, place: int) -> tuple[float, ...]:
    """Return a chain: up to half of the mass at the contact, through damper and spring to the rest of it."""
    mass, damping, stiffness = one_mass(rng, place)
    share = rng.uniform(0.2, 0.5)
    contact = rng.uniform(20.0, 60.0), rng.uniform(4000.0, 12000.0)
    return share * mass, *contact, (1.0 - share) * mass, damping, stiffness


def tone_hz(rng: np.random.Generator) -> float:
    """Return a frequency, 2 Hz or more from every multiple of mains."""
    while True:
        frequency = float(np.exp(rng.uniform(np.log(0.4), np.log(298.0))))
        if abs(frequency - MAINS_HZ * max(1, round(frequency / MAINS_HZ))) >= AWAY_HZ:
            return frequency


def worst_of(
    rng: np.random.Generator, place: int, own: ChannelController, finger: tuple[float, ...]
) -> tuple[float, int]:
    """Return a finger's worst error, dB, and how many of its tones reached the range and do not count."""
    channel, worst_db, at_range = felt.example().channels[place], 0.0, 0
    for k in range(TONES):
        frequency, level = tone_hz(rng), LEVELS_DB_SL[k % len(LEVELS_DB_SL)]
        time = felt.times(SETTLING_S + felt.tone_length_s(frequency))
        asked = 10.0 ** (level / 20.0) * np.sin(2.0 * np.pi * frequency * time)
        played = Device(felt.example(), place, own, int(rng.integers(2**31))).play(asked, [finger])
        if np.max(np.abs(played.command_v)) >= felt.FULL_V:
            at_range += 1
        else:
            worst_db = max(worst_db, abs(felt.tone_error_db(channel, played.y_v, frequency, level)))
    return worst_db, at_range


def main() -> int:
    """Print what share of the fingers is within 1 dB, and the worst; return 0 where that is as claimed."""
    given = felt.arguments(__doc__, 200, "fingers of one mass", fixed="judge the fixed controller: broken")
    rng = np.random.default_rng(given.seed)
    kept = []
    for name, draw, count in (
        ("one mass", one_mass, given.count),
        ("two masses", two_masses, max(1, given.count // 5)),
    ):
        worst_db, at_range = np.zeros(count), 0
        for i in range(count):
            place = i % 3
            own = felt.fixed(place) if given.fixed else felt.adaptive(place)
            worst_db[i], left_out = worst_of(rng, place, own, draw(rng, place))
            at_range += left_out
        beyond = int(np.sum(worst_db > 1.0))
        print(f"{name}: {count} fingers, {count * TONES - at_range} tones, {at_range} more reached the range")
        if draw is one_mass:
            kept.append(felt.verdict(f"{beyond} of {count} beyond 1 dB, per cent", 100.0 * beyond / count, 5.0, "%"))
        kept.append(felt.verdict(f"{name}, worst error", float(np.max(worst_db)), 1.5))
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
