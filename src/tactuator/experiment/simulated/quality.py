"""Quality of a procedure in many simulated runs against Weibull observers with a known threshold, or a known curve.

The loop of the display is not simulated. Levels are relative to the true threshold, where psi, lapses included, reaches
its target, so that estimates are errors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.curve_prior import CurveKind
from tactuator.experiment.procedure.procedure import GUESS, START_ABOVE_DB, Playable, Procedure, procedure_kind
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.experiment.procedure.run_flags import run_flags
from tactuator.experiment.protocol.detection import CatchTrials, LoudShare
from tactuator.experiment.result.played import inattentive
from tactuator.parameters import Number, Positive, Share, Whole, table
from tactuator.perception.curve import COMFORT_DB_SL, Level, RelativeCurve
from tactuator.perception.psychometric import TARGET_3_DOWN_1_UP, Psychometric, Weibull, weibull_rise

NORMAL_PEOPLE = CurveKind("normal people", offset_db=4.0, tilt_db_per_decade=2.5, wave_db=2.0, wave_decades=0.35)
"""People whose curves are drawn where none is given. Near the procedure's prior, they show it at its best."""


@table("")
class Setting:
    """Settings of a simulation of runs; slopes of the Weibull are drawn between the two for each run."""

    runs: Annotated[Whole, Field(ge=2, description="number of runs")]
    slope: Annotated[tuple[Positive, Positive], Field(description="lowest and highest Weibull slope")] = (2.5, 2.5)
    lapse: Annotated[Number, Field(description="lapse rate")] = 0.0
    start_db: Annotated[Level, Field(description="first trial above the expected truth")] = START_ABOVE_DB
    seed: Annotated[Whole, Field(ge=0, description="of all that is drawn")] = 0
    guessed: Annotated[Share, Field(description="share of trials that are guessed outright")] = 0.0
    drift_db: Annotated[Number, Field(ge=-60.0, le=60.0, description="rise of thresholds over a typical run")] = 0.0
    loud_share: Annotated[LoudShare, Field(description="share of loud catch trials")] = 0.0

    def __post_init__(self) -> None:
        if not self.slope[0] <= self.slope[1]:
            raise BadInput(f"{self.slope[0]:g} to {self.slope[1]:g}", "positive, ascending", key="slope")
        Psychometric(Weibull(self.slope[0]), lapse=self.lapse)


@dataclass(frozen=True)
class RefitQuality:
    """Quality of the Bayesian refit of the same trials; coverage95: share of 95 % intervals that hold the truth."""

    bias_db: float
    rmse_db: float
    coverage95: float


@dataclass(frozen=True)
class Quality:
    """Quality of the procedure's own estimate.

    trials_*: of the procedure, catch trials left out. unfinished: number of runs that reached the trial limit without
    an estimate. flagged, flags: share of runs with any, and with each, of the flags chance, lapses, drift, attention.
    """

    bias_db: float
    sd_db: float
    rmse_db: float
    trials_mean: float
    trials_p05: float
    trials_p95: float
    refit: RefitQuality
    unfinished: int
    flagged: float
    flags: dict[str, float]


@dataclass(frozen=True)
class CurveQualityAt:
    """Quality of the curves at one frequency; coverage95: share of the people whose threshold the 95 % band holds."""

    frequency_hz: float
    rms_error_db: float
    coverage95: float


@dataclass(frozen=True)
class CurveQuality:
    """Quality of the curves at the frequencies that `thresholds` reports and exports.

    rms_error_db, bias_db: over observers and frequencies together. rms_error_median_db: median over observers.
    coverage95: share of these points inside the 95 % band. by_frequency: the same of each frequency. notch_excluded:
    share of the points at which a notch of 15 dB is excluded. flagged: share of runs with any flag. flags: share of
    runs with each flag. trials: of every run. people: origin of the observers' curves.
    """

    rms_error_db: float
    bias_db: float
    rms_error_median_db: float
    coverage95: float
    flagged: float
    flags: dict[str, float]
    trials: int
    people: str
    notch_excluded: float
    by_frequency: tuple[CurveQualityAt, ...]


@dataclass(frozen=True)
class WithLoud:
    """Order of all trials of several runs, each (runs, trials).

    placed: index of the procedure's trial that is played or, at a loud trial, is next. loud: True at loud trials.
    there: False where a run was over.
    """

    placed: NDArray[np.intp]
    loud: NDArray[np.bool_]
    there: NDArray[np.bool_]

    def levels(self, own_db: FloatArray, highest_db: FloatArray | float = COMFORT_DB_SL) -> FloatArray:
        """Return the level of every trial, NaN where a run was over; own_db: of the procedure's, (runs, own trials)."""
        level = np.take_along_axis(own_db, self.placed, axis=1)
        return np.where(
            self.there, np.where(self.loud, np.minimum(level + CatchTrials.above_db, highest_db), level), np.nan
        )

    def outcomes(self, outcomes: NDArray[np.bool_], loud: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the outcome of every trial: the procedure's, (runs, own trials), or a loud one's, (runs, trials)."""
        answered = np.where(self.loud, loud, np.take_along_axis(outcomes, self.placed, axis=1))
        return np.asarray(answered & self.there)


def with_loud_trials(trials: NDArray[np.int64], share: float, rng: np.random.Generator) -> WithLoud:
    """Return runs of the procedure's trials (their number in each run, (runs,)) with loud ones among them.

    share: probability that a trial is loud. A run ends with the last trial of its procedure.
    """
    runs, most = trials.size, int(trials.max())
    before = np.zeros((runs, most), dtype=np.int64) if share == 0.0 else rng.geometric(1.0 - share, (runs, most)) - 1
    played = np.where(np.arange(most) < trials[:, None], before + 1, 0)
    total = played.sum(axis=1)
    order_of = np.zeros((runs, int(total.max())), dtype=np.intp)
    loud = np.zeros(order_of.shape, dtype=np.bool_)
    for run in range(runs):
        order = np.repeat(np.arange(most), played[run])
        order_of[run, : total[run]] = order
        loud[run, : total[run] - 1] = order[1:] == order[:-1]
    return WithLoud(order_of, loud, np.arange(order_of.shape[1]) < total[:, None])


@dataclass(frozen=True)
class Simulated:
    """Runs of a procedure with observers whose truth is known.

    truth_db_sl: thresholds, (runs, places). level_db_sl, place, correct: (runs, trials), NaN (0, False) after a run's
    end; place: index of the frequency. trials: of the procedure, (runs,). own_db_sl: its estimates, (runs,), NaN
    without one. loud: whether each trial was a loud one, (runs, trials).
    """

    truth_db_sl: FloatArray
    level_db_sl: FloatArray
    place: NDArray[np.intp]
    correct: NDArray[np.bool_]
    loud: NDArray[np.bool_]
    trials: NDArray[np.int64]
    own_db_sl: FloatArray


class Observers:
    """Observers, one for each of so many runs, whose thresholds drift over a typical run."""

    def __init__(
        self, procedure: Procedure, setting: Setting, people: RelativeCurve | None, count: int, rng: np.random.Generator
    ) -> None:
        model = Psychometric(Weibull(1.0), GUESS, setting.lapse, TARGET_3_DOWN_1_UP)
        self._setting, self._model, self._trials = setting, model, procedure.typical_trials
        self.frequency_hz: FloatArray | None = None
        if procedure.chooses_frequency:
            self.frequency_hz = hertz = procedure.places(Playable())
            if people is None:
                self.truth_db_sl = NORMAL_PEOPLE.draw(hertz, float(np.sqrt(np.prod(Playable.band_hz))), count, rng)
            else:
                self.truth_db_sl = np.broadcast_to(people.level_db_sl_at(hertz), (count, hertz.size))
        self._slope = rng.uniform(*setting.slope, count)
        if not procedure.chooses_frequency:
            self.truth_db_sl = np.full((count, 1), procedure.expected_threshold())
            if procedure.scatter_db:
                self.truth_db_sl = self.truth_db_sl + rng.normal(0.0, procedure.scatter_db, (count, 1))

    def place(self, frequency_hz: FloatArray | None, count: int) -> NDArray[np.intp]:
        """Return the index of each run's frequency, (count,)."""
        if frequency_hz is None or self.frequency_hz is None:
            return np.zeros(count, dtype=np.intp)
        return np.asarray(np.argmin(np.abs(np.log(frequency_hz[:, None] / self.frequency_hz)), axis=1))

    def chance(self, place: NDArray[np.intp], level_db_sl: FloatArray, trial: NDArray[np.intp]) -> FloatArray:
        """Return the probability of a right answer; arguments (runs, trials)."""
        setting, model = self._setting, self._model
        drift_db = setting.drift_db * (trial / max(self._trials - 1.0, 1.0) - 0.5)
        above_db = level_db_sl - np.take_along_axis(self.truth_db_sl, place, axis=1) - drift_db
        felt = weibull_rise(above_db, self._slope[:, None], model.at_threshold)
        felt = model.guess + (1.0 - model.guess - model.lapse) * felt
        return np.asarray(setting.guessed * model.guess + (1.0 - setting.guessed) * felt)


def simulated(
    procedure: Procedure, setting: Setting, count: int, rng: np.random.Generator, people: RelativeCurve | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Simulated:  # fmt: skip
    """Run the procedure with so many observers to the end, and put loud trials among its own."""
    observers = Observers(procedure, setting, people, count, rng)
    if setting.start_db != START_ABOVE_DB:
        procedure = procedure.expecting(procedure.expected_threshold() + setting.start_db - START_ABOVE_DB)
    runs = procedure.begin(count=count)
    levels, places, answers = list[FloatArray](), list[NDArray[np.intp]](), list[NDArray[np.bool_]]()
    while not (over := runs.over).all():
        level, place = runs.level_db_sl, observers.place(runs.frequency_hz, count)
        trial = np.array([[len(levels)]])
        right = rng.random(count) < observers.chance(place[:, None], level[:, None], trial)[:, 0]
        runs.record(right)
        levels.append(np.where(over, np.nan, level))
        places.append(place)
        answers.append(right & ~over)
        progress(runs.progress())
    own, place, correct = np.array(levels).T, np.array(places).T, np.array(answers).T
    order = with_loud_trials(runs.trials, setting.loud_share, rng)
    level, place = order.levels(own), np.take_along_axis(place, order.placed, axis=1)
    loud = rng.random(level.shape) < observers.chance(place, np.nan_to_num(level), order.placed)
    estimates = [runs.estimate(run) for run in range(count)]
    return Simulated(
        observers.truth_db_sl, level, place, order.outcomes(correct, loud), order.loud, runs.trials,
        np.array([np.nan if each is None else each.level_db_sl for each in estimates]),
    )  # fmt: skip


def simulate(
    procedure: Procedure,
    setting: Setting,
    people: RelativeCurve | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Quality | CurveQuality:
    """Run the procedure `setting.runs` times and judge its estimates, or its curves.

    people: everybody's curve where the procedure measures one; None: drawn from NORMAL_PEOPLE. progress: called with
    the share that is done. Raises BadInput where no run comes to its end, and for a start that the procedure lacks.
    """
    rng, judged = np.random.default_rng(setting.seed), []
    for first in range(0, setting.runs, procedure.runs_at_once):
        count = min(procedure.runs_at_once, setting.runs - first)
        done = simulated(
            procedure,
            setting,
            count,
            rng,
            people,
            lambda share: progress((first + count * share) / setting.runs),  # noqa: B023
        )
        judged.append(_curves(procedure, done) if procedure.chooses_frequency else _levels(done))
    names = [flags for part in judged for flags in part[0]]
    columns = [np.concatenate(column) for column in zip(*(part[1] for part in judged), strict=True)]
    if not procedure.chooses_frequency:
        return _quality(names, *columns)
    error, within, excluded = columns
    rms, share = np.sqrt(np.mean(error**2, axis=0)).tolist(), within.mean(axis=0).tolist()
    return CurveQuality(
        rms_error_db=float(np.sqrt(np.mean(error**2))),
        bias_db=float(error.mean()),
        rms_error_median_db=float(np.median(np.sqrt(np.mean(error**2, axis=1)))),
        coverage95=float(within.mean()),
        **shares(names),
        trials=round(procedure.typical_trials),
        people="drawn: normal people near the procedure's own prior" if people is None else people.name,
        notch_excluded=float(excluded.mean()),
        by_frequency=tuple(map(CurveQualityAt, procedure.places(Playable()).tolist(), rms, share)),
    )


Judged = tuple[list[tuple[str, ...]], tuple[NDArray[Any], ...]]
"""Names of the flags of each run, and columns with a row for each run."""


def _attention(done: Simulated, run: int) -> tuple[str, ...]:
    """Return the flag `attention` where the run missed too many of its loud trials."""
    loud = done.loud[run]
    return ("attention",) if inattentive(int(np.sum(loud & ~done.correct[run])), int(loud.sum())) else ()


def _levels(done: Simulated) -> Judged:
    """Return flags, errors of the procedure and of the refit, whether the interval holds the truth, and trials."""
    above = done.level_db_sl - done.truth_db_sl
    fitted = refit(above, done.correct, RefitPrior())
    tests = run_flags(above, done.correct, fitted, RefitPrior())
    names = [(*tests.names(run), *_attention(done, run)) for run in range(len(above))]
    covered = (fitted.low_db <= 0.0) & (fitted.high_db >= 0.0)
    return names, (done.own_db_sl - done.truth_db_sl[:, 0], fitted.threshold_db, covered, done.trials)


def _quality(
    names: Sequence[tuple[str, ...]], own_db: FloatArray, refit_db: FloatArray, covered: FloatArray, trials: FloatArray
) -> Quality:
    errors = own_db[np.isfinite(own_db)]
    if errors.size < 2:
        raise BadInput("not one run came to its end", "a trial limit that lets runs end")
    low, high = np.percentile(trials, [5.0, 95.0])
    return Quality(
        bias_db=float(errors.mean()),
        sd_db=float(errors.std(ddof=1)),
        rmse_db=float(np.sqrt(np.mean(errors**2))),
        trials_mean=float(trials.mean()),
        trials_p05=float(low),
        trials_p95=float(high),
        refit=RefitQuality(float(refit_db.mean()), float(np.sqrt(np.mean(refit_db**2))), float(covered.mean())),
        unfinished=own_db.size - errors.size,
        **shares(names),
    )


def _curves(procedure: Procedure, done: Simulated) -> Judged:
    """Return flags, error, whether the band holds the truth and whether a notch is excluded, (runs, points) each."""
    names, rows, hertz = [], [], procedure.places(Playable())
    for run, truth in enumerate(done.truth_db_sl):
        played = np.isfinite(done.level_db_sl[run])
        trials = hertz[done.place[run]][played], done.level_db_sl[run][played], done.correct[run][played]
        curve = procedure.curve(GUESS, Playable(), *trials)
        names.append((*curve.flags, *_attention(done, run)))
        rows.append((curve.mean - truth, (curve.low <= truth) & (truth <= curve.high), curve.notch_trials == 0))
    return names, tuple(np.array(column) for column in zip(*rows, strict=True))


def shares(names: Sequence[tuple[str, ...]]) -> dict[str, Any]:
    """Return the share of runs with any flag and with each, from the names of each run's flags."""
    each = sorted({name for flags in names for name in flags})
    flags = {name: float(np.mean([name in each_run for each_run in names])) for name in each}
    return {"flagged": float(np.mean([bool(each_run) for each_run in names])), "flags": flags}


def simulate_kind(
    name: str,
    setting: Setting,
    trials: int | None = None,
    people: RelativeCurve | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Quality | CurveQuality:
    """Judge the kind of procedure of that name, of this package or another, with its own defaults.

    trials: of a run, None: as the kind has it. people, progress: as `simulate` has them. Raises BadInput for a kind
    that nobody declares, a number of trials where the kind has none, and people where it measures no curve.
    """
    kind = procedure_kind(name)
    if trials is not None and "trials" not in {key.name for key in fields(kind)}:
        raise BadInput(f"`trials` {trials} with {name}", "with a procedure that has a number of trials")
    if people is not None and not kind.chooses_frequency:
        raise BadInput(f"`truth` with {name}", "with curve")
    procedure = kind(kind=name) if trials is None else kind(kind=name, trials=trials)  # type: ignore[call-arg]
    return simulate(procedure, setting, people, progress)
