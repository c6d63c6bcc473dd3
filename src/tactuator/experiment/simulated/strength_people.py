"""Simulated people with a law of felt strength of their own, who match, estimate, discriminate and err.

Their laws are functions of what is felt, channel by channel, and share nothing with the estimation's models but names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.task.task_keys import JudgedTone, Judgement
from tactuator.perception.contours import REFERENCE_HZ
from tactuator.perception.curve import ThresholdCurve
from tactuator.perception.psychometric import TARGET_3_DOWN_1_UP, MaxOfM

WAVES = "waves"
LAW_NAMES = ("sensation-level", "exponents", "sum-of-channels", "equal-velocity", WAVES)
"""Laws that people may have: each of the estimation's, and one of their own, which is none of them."""

Strength = Callable[[FloatArray, FloatArray], FloatArray]
"""Function of frequency (Hz) and sensation level (dB SL), (n,) each: strength in dB, which rises with the level."""


@dataclass(frozen=True)
class Channels:
    """Thresholds of two channels, dB: the Pacinian one falls by fall_db an octave up to best_hz and rises beyond, the
    other is flat above 30 Hz; they cross at crossing_hz.
    """

    crossing_hz: float
    fall_db: float = 11.0
    best_hz: float = 250.0

    def above(self, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far each channel's threshold, Pacinian first, lies above the more sensitive one's, (n,) each."""
        pacinian = -self.fall_db * np.log2(np.minimum(frequency_hz, self.best_hz) / self.crossing_hz)
        pacinian = pacinian + self.fall_db * np.maximum(0.0, np.log2(frequency_hz / self.best_hz))
        best = np.minimum(pacinian, 0.0)
        return pacinian - best, -best


@dataclass(frozen=True)
class StrengthPerson:
    """A person who judges.

    law: its name. strength: the law. noise_db: scatter of one tone's felt level. order_db, standard_db: how much
    stronger the second interval is felt, and the tone that serves as standard. amplitude_jnd_db, frequency_jnd,
    gap_jnd_ms, order_jnd_ms: differences that are answered rightly in 79.4 % of trials of `intervals`. modulus: number
    for a strength of 0 dB. exponent: of magnitude over amplitude at a strength of 1 dB for 1 dB. estimate_sd: scatter
    of the natural log of an estimate. lapse: share of trials that are answered blindly.
    """

    law: str
    strength: Strength
    noise_db: float = 1.7
    order_db: float = 0.0
    standard_db: float = 0.0
    lapse: float = 0.02
    amplitude_jnd_db: float = 2.0
    frequency_jnd: float = 0.2
    gap_jnd_ms: float = 20.0
    order_jnd_ms: float = 40.0
    modulus: float = 1.0
    exponent: float = 0.6
    estimate_sd: float = 0.25

    def equal_to(self, level_db_sl: float, frequency_hz: FloatArray) -> FloatArray:
        """Return the levels at frequencies (n,) that are as strong as that level at the reference frequency."""
        return equal_level(self.strength, REFERENCE_HZ, frequency_hz, np.full(frequency_hz.shape, level_db_sl))

    def answer(self, trial: Judgement, felt_db_sl: Sequence[float], rng: np.random.Generator) -> str:
        """Return a response. felt_db_sl: level of the first tone of each interval as it was felt."""
        if not trial.responses:
            return self._number(trial.tones[0][0], felt_db_sl[0], rng)
        if rng.random() < self.lapse:
            return trial.responses[int(rng.integers(len(trial.responses)))]
        roles = [tones[0].role for tones in trial.tones]
        if "standard" in roles:
            return trial.responses[int(np.argmax(self._strengths(trial, felt_db_sl, rng)))]
        if len(trial.tones) == 1:
            return self._first(trial.tones[0], rng)
        return trial.responses[self._different(trial, felt_db_sl, rng)]

    def _strengths(self, trial: Judgement, felt_db_sl: Sequence[float], rng: np.random.Generator) -> FloatArray:
        tones = [interval[0] for interval in trial.tones]
        level = np.array(felt_db_sl) + self.noise_db * rng.standard_normal(len(tones))
        level[-1] += self.order_db
        level += self.standard_db * np.array([tone.role == "standard" for tone in tones])
        return self.strength(np.array([tone.frequency_hz for tone in tones]), level)

    def _number(self, tone: JudgedTone, felt_db_sl: float, rng: np.random.Generator) -> str:
        strength = float(self.strength(np.array([tone.frequency_hz]), np.array([felt_db_sl]))[0])
        log = self.exponent * strength * np.log(10.0) / 20.0 + self.estimate_sd * rng.standard_normal()
        return f"{self.modulus * np.exp(log):.2g}"

    def _different(self, trial: Judgement, felt_db_sl: Sequence[float], rng: np.random.Generator) -> int:
        """Return the interval that was strongest, highest or had a gap, of as many noisy impressions."""
        noise = rng.standard_normal(len(trial.tones)) / d_prime(len(trial.tones))
        tones = [interval[0] for interval in trial.tones]
        hertz = np.array([tone.frequency_hz for tone in tones])
        gaps_ms = np.array([_gap_ms(interval) for interval in trial.tones])
        if np.any(gaps_ms > 0.0):
            return int(np.argmax(gaps_ms / self.gap_jnd_ms + noise))
        if np.ptp(hertz) > 0.0:
            return int(np.argmax((hertz / hertz.min() - 1.0) / self.frequency_jnd + noise))
        return int(np.argmax(np.array(felt_db_sl) / self.amplitude_jnd_db + noise))

    def _first(self, tones: Sequence[JudgedTone], rng: np.random.Generator) -> str:
        early, late = tones
        apart_ms = 1e3 * (late.onset_s - early.onset_s) / self.order_jnd_ms
        noise = rng.standard_normal() * np.sqrt(2.0) / d_prime(2)
        return early.finger if apart_ms + noise > 0.0 else late.finger


def d_prime(intervals: int) -> float:
    """Return the d' at which 79.4 % are right in that many intervals (Green & Swets 1966, chapter 2)."""
    guess = 1.0 / intervals
    return float(MaxOfM(intervals, 1.0).d_prime(0.0, (TARGET_3_DOWN_1_UP - guess) / (1.0 - guess)))


def _gap_ms(tones: Sequence[JudgedTone]) -> float:
    if len(tones) < 2:
        return 0.0
    first, second = tones
    return 1e3 * (second.onset_s - first.onset_s - (first.duration_s or 0.0))


def strength_law(name: str, library: ThresholdCurve, rng: np.random.Generator) -> Strength:
    """Return a law of that name, with what it leaves to the person drawn. Raises BadInput for a name that is none."""
    channels, exponent = Channels(float(rng.uniform(32.0, 60.0)), float(rng.uniform(9.0, 12.0))), rng.uniform(0.6, 0.95)
    ratio, width_db = rng.uniform(1.5, 2.2), rng.uniform(2.0, 8.0)

    def by_exponents(hertz: FloatArray, level: FloatArray) -> FloatArray:
        pacinian, other = channels.above(hertz)
        share = 1.0 / (1.0 + 10.0 ** ((pacinian - other) / width_db))
        return np.asarray(exponent * (share + ratio * (1.0 - share)) * level)

    def by_sum(hertz: FloatArray, level: FloatArray) -> FloatArray:
        sensed = [level - above for above in channels.above(hertz)]
        each = [np.where(db_sl > 0.0, 10.0 ** (exponent * db_sl / 20.0), 0.0) for db_sl in sensed]
        total = np.maximum(*each) + 0.5 * np.minimum(*each)
        below = np.minimum(level, 0.0)
        return np.asarray(20.0 * np.log10(np.maximum(total, 1.0)) + below)

    size_db, phase, steeper = rng.uniform(1.0, 3.0, 3), rng.uniform(0.0, 2.0 * np.pi, 3), rng.uniform(-0.15, 0.25)

    def by_waves(hertz: FloatArray, level: FloatArray) -> FloatArray:
        decades = np.log10(hertz / REFERENCE_HZ)[..., None]
        waves = np.sum(size_db * np.sin(2.0 * decades * np.arange(1, 4) + phase), axis=-1)
        return np.asarray(level * (1.0 + steeper * decades[..., 0]) + waves)

    laws: dict[str, Strength] = {
        "sensation-level": lambda hertz, level: np.asarray(exponent * level),
        "exponents": by_exponents,
        "sum-of-channels": by_sum,
        "equal-velocity": lambda hertz, level: np.asarray(
            level + library.level_db_re_1um_at(hertz) + 20.0 * np.log10(hertz)
        ),
        WAVES: by_waves,
    }
    if name not in laws:
        raise BadInput(f"law {name!r}", ", ".join(laws))
    return laws[name]


def equal_level(
    strength: Strength, reference_hz: float, frequency_hz: FloatArray, level_db_sl: FloatArray
) -> FloatArray:
    """Return the levels that are as strong as level_db_sl at the reference; arguments (n,)."""
    wanted = strength(np.full(level_db_sl.shape, reference_hz), level_db_sl)
    low, high = np.full(level_db_sl.shape, -60.0), np.full(level_db_sl.shape, 120.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        under = strength(frequency_hz, middle) < wanted
        low, high = np.where(under, middle, low), np.where(under, high, middle)
    return np.asarray(0.5 * (low + high))


def drawn_person(law: str, library: ThresholdCurve, lapse: float, rng: np.random.Generator) -> StrengthPerson:
    """Return a person of that law.

    Biases of 0.5 to 3 dB either way, each in half of the people; JNDs over the ranges of Israr, Tan & Reed (2006): 1.65
    to 2.98 dB, and 0.13 to 0.38 of the frequency; of gaps 10 to 40 ms and of order 20 to 80 ms, which nobody measured.
    """
    strength = strength_law(law, library, rng)
    order_db, standard_db = (
        float(rng.choice([0.0, -1.0, 1.0], p=[0.5, 0.25, 0.25]) * rng.uniform(0.5, 3.0)) for _ in range(2)
    )
    return StrengthPerson(
        law,
        strength,
        noise_db=float(rng.uniform(1.2, 2.3)),
        order_db=order_db,
        standard_db=standard_db,
        lapse=lapse,
        amplitude_jnd_db=float(rng.uniform(1.65, 2.98)),
        frequency_jnd=float(rng.uniform(0.13, 0.38)),
        modulus=float(np.exp(rng.normal(1.0, 1.0))),
        exponent=1.0,
        gap_jnd_ms=float(rng.uniform(10.0, 40.0)),
        order_jnd_ms=float(rng.uniform(20.0, 80.0)),
    )


def people_of(
    codes: Sequence[str], laws: Mapping[str, str], lapses: Mapping[str, float], library: ThresholdCurve, seed: int
) -> tuple[StrengthPerson, ...]:
    """Return a person for each code: of the law that is said, else each law in turn; lapses of 2 % unless said.

    Raises BadInput for a code that is not among `codes`, and for a law that is none.
    """
    strangers = sorted((set(laws) | set(lapses)) - set(codes))
    if strangers:
        raise BadInput(f"law or lapse of {', '.join(strangers)}", f"of the protocol's subjects {', '.join(codes)}")
    return tuple(
        drawn_person(
            laws.get(code, LAW_NAMES[place % len(LAW_NAMES)]),
            library,
            lapses.get(code, StrengthPerson.lapse),
            np.random.default_rng([seed, 17, place]),
        )
        for place, code in enumerate(codes)
    )
