"""What is not as designed: never unstable, and never more than 1 dB worse than the fixed controller.

A plant whose figures are each 10 % off; a tremor of 0.3 V at 7 Hz; a command that reaches its limit; and the numbers of
the estimator that become NaN, one after the other. Worse: |felt - curve| of a tone, adaptive less fixed, on the same
device (generator.c, which shares nothing with core's simulated display) with the same noise. Seen to fail with --wrong,
which feeds forward three times the mass.
"""

from __future__ import annotations

import itertools
import sys

import numpy as np

from tactuator.arrays import FloatArray
from witnesses.touch import felt
from witnesses.touch.device import Device, Played
from witnesses.touch.fingers import LEVELS_DB_SL, SETTLING_S

TREMOR_HZ, TREMOR_V = 7.0, 0.3
PLANT_TONES_HZ = (1.7, 11.0, 31.0, 78.0, 250.0)
TREMOR_TONES_HZ = (2.5, 19.0, 31.0, 78.0, 155.0, 250.0)
LOUD_HZ = (205.0, 250.0, 298.0)
LOUD_DB_SL = (48.0, 50.0, 52.0, 54.0, 56.0)
PLANTS = tuple((gain, damping, stiffness) for gain in (0.9, 1.1) for damping in (0.9, 1.1) for stiffness in (0.9, 1.1))
TRAVEL_V = 12.5 * 0.2
"""Volts at the sensor: what is beyond is unstable, not loud."""


class Worse:
    """The worst of many tones: by how much adaptive is worse than fixed."""

    def __init__(self, wrong: bool, seed: int) -> None:
        self._wrong, self._seed = wrong, seed
        self.worst_db, self.tones, self.is_stable, self.full = -np.inf, 0, True, 0

    def tone(
        self,
        place: int,
        frequency_hz: float,
        level_db_sl: float,
        touched: bool,
        plant: tuple[float, float, float] = (1.0, 1.0, 1.0),
        tremor_v: float = 0.0,
    ) -> None:
        """Play a tone adaptively and fixed."""
        self._seed += 1
        time = felt.times(SETTLING_S + felt.tone_length_s(frequency_hz))
        asked = 10.0 ** (level_db_sl / 20.0) * np.sin(2.0 * np.pi * frequency_hz * time)
        force = tremor_v * np.sin(2.0 * np.pi * TREMOR_HZ * time)
        fingers = (felt.nominal(place),) if touched else ()
        errors = []
        for own in (felt.judged(place, self._wrong), felt.fixed(place)):
            played = Device(felt.example(), place, own, self._seed, plant).play(asked, fingers, force_v=force)
            errors.append(abs(self._error_db(place, played, frequency_hz, level_db_sl)))
        self.worst_db, self.tones = max(self.worst_db, errors[0] - errors[1]), self.tones + 1

    def _error_db(self, place: int, played: Played, frequency_hz: float, level_db_sl: float) -> float:
        self.is_stable &= bool(np.all(np.abs(played.y_v) < TRAVEL_V))
        self.full += bool(np.max(np.abs(played.command_v)) >= felt.FULL_V)
        return felt.tone_error_db(felt.example().channels[place], played.y_v, frequency_hz, level_db_sl)

    def verdict(self, what: str) -> bool:
        """Print what was found; tell whether it is kept."""
        kept = felt.verdict(f"{what}, {self.tones} tones: worse than fixed by", self.worst_db, 1.0)
        return felt.verdict(f"{what}: runs that left the travel", float(not self.is_stable), 0.0, "") and kept


def wrong_plant(worse: Worse) -> bool:
    """Judge each combination of figures 10 % off, free and touched."""
    for place, signs in itertools.product(range(3), PLANTS):
        for frequency, touched in itertools.product(PLANT_TONES_HZ, (False, True)):
            worse.tone(place, frequency, LEVELS_DB_SL[(place + round(frequency)) % 4], touched, signs)
    return worse.verdict("plant 10 % off")


def tremor(worse: Worse) -> bool:
    """Judge a tremor under tones of each level."""
    for place, level, frequency in itertools.product(range(3), LEVELS_DB_SL, TREMOR_TONES_HZ):
        for touched in (False, True):
            worse.tone(place, frequency, level, touched, tremor_v=TREMOR_V)
    return worse.verdict("tremor of 0.3 V at 7 Hz")


def saturated(worse: Worse) -> bool:
    """Judge tones that reach the command's limit, touched."""
    for place, level, frequency in itertools.product(range(3), LOUD_DB_SL, LOUD_HZ):
        worse.tone(place, frequency, level, True)
    print(f"saturated: {worse.full} of {2 * worse.tones} runs reached the limit")
    return worse.verdict("a command that is limited")


def spoilt(wrong: bool, seed: int) -> bool:
    """Judge every number of the estimator that becomes NaN, or infinite, while noise plays."""
    time = felt.times(2.0)
    asked = 10.0**1.5 * np.random.default_rng(seed).standard_normal(time.size)
    half = time.size // 2
    worst_db, count, at = -np.inf, 0, 0
    reference_level: FloatArray | None = None
    while True:
        for value in (float("nan"), float("inf"), -1e38):
            device = Device(felt.example(), 0, felt.judged(0, wrong), seed)
            device.play(asked[:half], (felt.nominal(0),))
            if not device.spoil(at, value):
                kept = felt.verdict(f"{count} spoilt numbers: too high at most", worst_db, 1.0)
                return kept and count > 0
            after = device.play(asked[half:], (felt.nominal(0),)).y_v
            if reference_level is None:
                free = Device(felt.example(), 0, felt.fixed(0), seed)
                free.play(asked[:half])
                reference_level = felt.felt_over_time(felt.example().channels[0], free.play(asked[half:]).y_v)
            level = felt.felt_over_time(felt.example().channels[0], after)
            found = float(np.max(20.0 * np.log10(level / reference_level)))
            worst_db = max(worst_db, found if np.isfinite(found) else np.inf)
            count += 1
        at += 1


def main() -> int:
    """Print the worst of each; return 0 where all are kept."""
    given = felt.arguments(
        __doc__, 1, "not used: everything is tried once", wrong="feed forward three times the mass: broken"
    )
    kept = [
        judge(Worse(given.wrong, 1000 * given.seed + 100 * place))
        for place, judge in enumerate((wrong_plant, tremor, saturated))
    ]
    kept.append(spoilt(given.wrong, given.seed))
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
