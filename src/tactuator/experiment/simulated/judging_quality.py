"""Quality of matching, magnitude estimation and discrimination with simulated people of a known law of strength."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Playable
from tactuator.experiment.simulated.strength_people import LAW_NAMES, WAVES, StrengthPerson, drawn_person, equal_level
from tactuator.experiment.task.discrimination import UNITS, DiscriminationKeys
from tactuator.experiment.task.estimate import CANNOT_TELL, StrengthEstimate, estimate
from tactuator.experiment.task.laws import FREE
from tactuator.experiment.task.magnitude_estimation import EstimationKeys, magnitudes
from tactuator.experiment.task.matching import MatchingKeys
from tactuator.experiment.task.task_keys import Answered, AnsweredRun, Place, TaskKeys
from tactuator.experiment.trial import Timing
from tactuator.perception.curve import COMFORT_DB_SL, ThresholdCurve, curve

_FINGERS = ("index", "thumb")
_FINGER = _FINGERS[0]
_LIBRARY = "bolanowski-1988"
_NORMAL_95 = 1.959964
_LEAST_DB_SL = 3.0


@dataclass(frozen=True)
class JudgingSetting:
    """Settings of a simulation. law: everybody's, None: each in turn. trials: of a matching run, None: as usual."""

    runs: int
    lapse: float = StrengthPerson.lapse
    seed: int = 0
    law: str | None = None
    trials: int | None = None

    def person(self, number: int, library: ThresholdCurve) -> StrengthPerson:
        """Return the person of that number."""
        law = LAW_NAMES[number % len(LAW_NAMES)] if self.law is None else self.law
        return drawn_person(law, library, self.lapse, np.random.default_rng([self.seed, 17, number]))


def answered(keys: TaskKeys, index: int, person: StrengthPerson, seed: tuple[int, ...]) -> AnsweredRun:
    """Return a run of the task's plan of that index, answered by a person who feels what is commanded."""
    run, rng = keys.begin(index, Place(Playable(), Timing()), seed), np.random.default_rng(seed)
    trials = list[Answered]()
    while (trial := run.trial(len(trials))) is not None:
        response = person.answer(trial, [tones[0].level_db_sl for tones in trial.tones], rng)
        run.record(trial, response)
        trials.append(Answered.of(trial, response))
    at = trials[0].tones[0] if trials else None
    return AnsweredRun("S", _FINGER, None if at is None else at.frequency_hz, tuple(trials), True)


@dataclass(frozen=True)
class MatchingQuality:
    """Quality of contours, even in log frequency, 10 to 50 dB SL, where both tones may be played.

    rms_error_db: mean over people of each one's rms error. worst_rms_error_db: the largest of them. coverage95: share
    of the contours inside their 95 % bands. law_right, law_wrong: shares of people whose law is named rightly, and
    wrongly; of the others none is named. order_rms_db, standard_rms_db: errors of the biases; *_within: share of people
    where they are within 0.5 dB. jnd_ratio: found over true noise, the median.
    """

    rms_error_db: float
    worst_rms_error_db: float
    coverage95: float
    law_right: float
    law_wrong: float
    order_rms_db: float
    order_within: float
    standard_rms_db: float
    standard_within: float
    jnd_ratio: float
    trials: int


_BIAS_WITHIN_DB = 0.5
_JND_OF_NOISE = 0.67449 * np.sqrt(2.0)


def simulate_matching(
    setting: JudgingSetting, progress: Callable[[float], None] = lambda share: None
) -> MatchingQuality:
    """Let people match over the whole contour, and judge what is result."""
    keys = MatchingKeys(finger=_FINGER, **({} if setting.trials is None else {"trials": setting.trials}))  # type: ignore[arg-type]
    library, rows = curve(_LIBRARY), []
    at = replace(keys.setting, curve=library)
    for number in range(setting.runs):
        person = setting.person(number, library)
        run = answered(keys, 0, person, (setting.seed, 19, number))
        rows.append(_judged(person, estimate(keys.matches(run.trials), at), keys))
        progress((number + 1) / setting.runs)
    columns = np.array(rows).T
    rms, inside, right, wrong, order, standard, noise = columns
    return MatchingQuality(
        rms_error_db=float(rms.mean()),
        worst_rms_error_db=float(rms.max()),
        coverage95=float(inside.mean()),
        law_right=float(right.mean()),
        law_wrong=float(wrong.mean()),
        order_rms_db=float(np.sqrt(np.mean(order**2))),
        order_within=float(np.mean(np.abs(order) <= _BIAS_WITHIN_DB)),
        standard_rms_db=float(np.sqrt(np.mean(standard**2))),
        standard_within=float(np.mean(np.abs(standard) <= _BIAS_WITHIN_DB)),
        jnd_ratio=float(np.median(noise)),
        trials=keys.trials,
    )


def _judged(person: StrengthPerson, result: StrengthEstimate, keys: MatchingKeys) -> tuple[float, ...]:
    hertz, level = (each.ravel() for each in np.meshgrid(np.geomspace(*keys.band_hz, 24), np.arange(10.0, 51.0, 5.0)))
    truth = equal_level(person.strength, keys.frequency_hz, hertz, level)
    seen = (truth <= COMFORT_DB_SL) & (truth >= _LEAST_DB_SL)
    mean, sd = result.levels(hertz, level)
    error = (mean - truth)[seen]
    within = np.abs(error) <= _NORMAL_95 * sd[seen] + 1e-9
    right = FREE.name if person.law == WAVES else person.law
    named = result.law
    return (
        float(np.sqrt(np.mean(error**2))),
        float(within.mean()),
        float(named == right),
        float(named not in (right, CANNOT_TELL)),
        result.order_db.value - person.order_db,
        result.standard_db.value - person.standard_db,
        result.jnd_db.value / (_JND_OF_NOISE * person.noise_db),
    )


@dataclass(frozen=True)
class DifferenceQuality:
    """Quality of one just-noticeable difference in the task's unit.

    bias, rms: error of the refit. coverage95: share of 95 % intervals that hold the truth. trials: mean of a run.
    """

    bias: float
    rms: float
    coverage95: float
    trials: float


@dataclass(frozen=True)
class DiscriminationQuality:
    """Quality of JNDs at 100 Hz and 20 dB SL: amplitude (dB), frequency (%), gap and order of two fingers (ms)."""

    amplitude: DifferenceQuality
    frequency: DifferenceQuality
    gap: DifferenceQuality
    order: DifferenceQuality


def simulate_discrimination(
    setting: JudgingSetting, progress: Callable[[float], None] = lambda share: None
) -> DiscriminationQuality:
    """Let people tell tones apart by the default procedure, and judge what is result."""
    library, rows = curve(_LIBRARY), list[list[list[float]]]()
    for number in range(setting.runs):
        person = setting.person(number, library)
        truths = (person.amplitude_jnd_db, 100.0 * person.frequency_jnd, person.gap_jnd_ms, person.order_jnd_ms)
        rows.append([])
        for place, (of, truth) in enumerate(zip(UNITS, truths, strict=True)):
            keys = DiscriminationKeys(of=of, fingers=_FINGERS[: 1 + (of == "order")], frequencies_hz=(100.0,))
            run = answered(keys, 0, person, (setting.seed, 23, number, place))
            jnd = keys.difference(run).jnd
            rows[-1].append([jnd.value - truth, float(jnd.low <= truth <= jnd.high), float(len(run.trials))])
        progress((number + 1) / setting.runs)
    columns = np.array(rows).transpose(1, 2, 0)
    return DiscriminationQuality(
        *(DifferenceQuality(float(off.mean()), _rms(off), float(held.mean()), float(count.mean()))
          for off, held, count in columns)
    )  # fmt: skip


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class MagnitudeQuality:
    """Quality of exponents at 30, 100 and 250 Hz: error of the slope, share of 95 % intervals that hold it."""

    exponent_bias: float
    exponent_rms: float
    coverage95: float
    trials: int


def simulate_magnitudes(
    setting: JudgingSetting, progress: Callable[[float], None] = lambda share: None
) -> MagnitudeQuality:
    """Let people estimate magnitudes, and judge the exponents."""
    library, errors, inside = curve(_LIBRARY), list[float](), list[bool]()
    keys = EstimationKeys(finger=_FINGER, frequencies_hz=(30.0, 100.0, 250.0))
    count = 0
    for number in range(setting.runs):
        person = setting.person(number, library)
        run = answered(keys, 0, person, (setting.seed, 29, number))
        count = len(run.trials)
        for each in magnitudes([run]):
            strength = person.strength(np.full(each.level_db_sl.shape, each.frequency_hz), each.level_db_sl)
            truth = person.exponent * float(np.polyfit(each.level_db_sl, strength, 1)[0])
            errors.append(each.exponent.value - truth)
            inside.append(each.exponent.low <= truth <= each.exponent.high)
        progress((number + 1) / setting.runs)
    return MagnitudeQuality(float(np.mean(errors)), _rms(np.array(errors)), float(np.mean(inside)), count)


JudgingQuality = MatchingQuality | DiscriminationQuality | MagnitudeQuality

TASKS: dict[str, Callable[[JudgingSetting, Callable[[float], None]], JudgingQuality]] = {
    "matching": simulate_matching,
    "magnitude-estimation": simulate_magnitudes,
    "discrimination": simulate_discrimination,
}


def simulate_judging(
    task: str, setting: JudgingSetting, progress: Callable[[float], None] = lambda share: None
) -> JudgingQuality:
    """Judge the task of that name, one of TASKS. Raises BadInput for another law, or trials of another task."""
    if setting.law is not None and setting.law not in LAW_NAMES:
        raise BadInput(f"law {setting.law!r}", ", ".join(LAW_NAMES))
    if setting.trials is not None and task != "matching":
        raise BadInput(f"--trials {setting.trials} with {task}", "with matching")
    return TASKS[task](setting, progress)
