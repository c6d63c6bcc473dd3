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
from tactuator.experiment.procedure.curve_belief import CurveBelief
from tactuator.experiment.procedure.curve_prior import CurveKind
from tactuator.experiment.procedure.procedure import Playable, ProcedureKeys, procedure_kind
from tactuator.experiment.procedure.quest_plus import QuestPlusKeys, QuestPlusRule, run_quests
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.experiment.procedure.run_flags import run_flags, unseen_notch
from tactuator.experiment.procedure.up_down import PaperKeys, Probability, Tracks, UpDownRule, run_tracks
from tactuator.experiment.procedure.whole_curve import CurveKeys, Trials, WholeCurveRule, curve_flags
from tactuator.experiment.protocol.detection import CatchTrials, LoudShare
from tactuator.experiment.result.played import inattentive
from tactuator.parameters import Number, Positive, Share, Whole, table
from tactuator.perception.curve import COMFORT_DB_SL, RelativeCurve
from tactuator.perception.psychometric import Psychometric, Weibull, weibull_rise

_START_ABOVE_EXPECTED_DB = UpDownRule.start_db_sl
_SCATTER_DB = 5.0
_GUESS = Psychometric(Weibull(1.0)).guess

NORMAL_PEOPLE = CurveKind("normal people", offset_db=4.0, tilt_db_per_decade=2.5, wave_db=2.0, wave_decades=0.35)
"""People whose curves are drawn where none is given. Near the procedure's prior, they show it at its best."""

_BATCH_RUNS = 50


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

    def attention(self, run: int, correct: NDArray[np.bool_]) -> tuple[str, ...]:
        """Return the flag `attention` where the run missed too many of its loud trials; correct: (runs, trials)."""
        loud = self.loud[run]
        return ("attention",) if inattentive(int(np.sum(loud & ~correct[run])), int(loud.sum())) else ()


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


@table("simulation")
class Setting:
    """Settings of a simulation of runs; slopes of the Weibull are drawn between the two for each run."""

    runs: Annotated[Whole, Field(ge=2, description="number of runs")]
    slope: Annotated[tuple[Positive, Positive], Field(description="lowest and highest Weibull slope")] = (2.5, 2.5)
    lapse: Annotated[Number, Field(description="lapse rate")] = 0.0
    start_db: Annotated[Number, Field(ge=-40.0, le=60.0, description="first trial above the truth")] = 20.0
    seed: Annotated[Whole, Field(ge=0, description="of all that is drawn")] = 0
    guessed: Annotated[Share, Field(description="share of trials that are guessed outright")] = 0.0
    drift_db: Annotated[Number, Field(ge=-60.0, le=60.0, description="rise of thresholds over a typical run")] = 0.0
    loud_share: Annotated[LoudShare, Field(description="share of loud catch trials")] = 0.0

    def __post_init__(self) -> None:
        if not self.slope[0] <= self.slope[1]:
            raise BadInput(f"{self.slope[0]:g} to {self.slope[1]:g}", "positive, ascending", key="slope")
        Psychometric(Weibull(self.slope[0]), lapse=self.lapse)

    def drifted_db(self, trial: NDArray[np.intp] | int, trials: float) -> FloatArray:
        """Return how far above their mean thresholds are at a trial of a run of so many."""
        return self.drift_db * (np.asarray(trial) / max(trials - 1.0, 1.0) - 0.5)

    def chance(self, model: Psychometric, above_db: FloatArray, slope: FloatArray) -> FloatArray:
        """Return the probability of a right answer above the threshold, by a Weibull, or guessed outright."""
        felt = model.guess + (1.0 - model.guess - model.lapse) * weibull_rise(above_db, slope, model.at_threshold)
        return np.asarray(self.guessed * model.guess + (1.0 - self.guessed) * felt)


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


def simulate(procedure: ProcedureKeys, setting: Setting) -> Quality:
    """Run the procedure `setting.runs` times and judge its estimates. Raises BadInput where no run comes to its end."""
    rng = np.random.default_rng(setting.seed)
    tracks, truth = run_procedure(procedure, setting, rng)
    errors = tracks.estimates_db_sl - truth.threshold
    errors = errors[np.isfinite(errors)]
    if errors.size < 2:
        raise BadInput("not one run came to its end", "a trial limit that lets runs end")
    levels, correct, loud = _with_loud(tracks, truth, setting, rng)
    again = refit(levels, correct, RefitPrior())
    error = again.threshold_db
    covered = (again.low_db <= 0.0) & (again.high_db >= 0.0)
    tests = run_flags(levels, correct, again, RefitPrior())
    low, high = np.percentile(tracks.trials, [5.0, 95.0])
    return Quality(
        bias_db=float(errors.mean()),
        sd_db=float(errors.std(ddof=1)),
        rmse_db=float(np.sqrt(np.mean(errors**2))),
        trials_mean=float(tracks.trials.mean()),
        trials_p05=float(low),
        trials_p95=float(high),
        refit=RefitQuality(float(error.mean()), float(np.sqrt(np.mean(error**2))), float(covered.mean())),
        unfinished=setting.runs - errors.size,
        **shares([(*tests.names(run), *loud.attention(run, correct)) for run in range(setting.runs)]),
    )


def shares(names: Sequence[tuple[str, ...]]) -> dict[str, Any]:
    """Return the share of runs with any flag and with each, from the names of each run's flags."""
    each = sorted({name for flags in names for name in flags})
    flags = {name: float(np.mean([name in each_run for each_run in names])) for name in each}
    return {"flagged": float(np.mean([bool(each_run) for each_run in names])), "flags": flags}


def _with_loud(
    tracks: Tracks, truth: _Truth, setting: Setting, rng: np.random.Generator
) -> tuple[FloatArray, NDArray[np.bool_], WithLoud]:
    """Return levels above the truth and outcomes of all trials, loud ones included, and their order."""
    order = with_loud_trials(tracks.trials, setting.loud_share, rng)
    levels = order.levels(tracks.levels_db_sl)
    numbers = np.broadcast_to(np.arange(setting.runs)[:, None], levels.shape)
    loud = rng.random(levels.shape) < truth(np.nan_to_num(levels), numbers, order.placed)
    return levels - truth.threshold[:, None], order.outcomes(tracks.correct, loud), order


def run_procedure(procedure: ProcedureKeys, setting: Setting, rng: np.random.Generator) -> tuple[Tracks, _Truth]:
    """Return the tracks in dB SL, and the truths.

    The first trial of a run lies start_db above the truth. _Truths of QUEST+, which chooses its first level by what it
    expects, scatter about that: an experimenter who starts a track start_db above the threshold expects the threshold
    _START_ABOVE_EXPECTED_DB below that start, so that the truth lies _START_ABOVE_EXPECTED_DB - start_db above what the
    rule expects, on average.
    """
    slopes, zero = rng.uniform(*setting.slope, setting.runs), np.zeros(setting.runs)
    rule = procedure.rule if isinstance(procedure, PaperKeys) else procedure
    if isinstance(rule, UpDownRule):
        truth = _Truth(setting, slopes, zero, rule.typical_trials)
        return run_tracks(rule, np.full(setting.runs, setting.start_db), truth, rng), truth
    if isinstance(rule, QuestPlusKeys):
        centre = rule.expected_db_sl + _START_ABOVE_EXPECTED_DB - setting.start_db
        truth = _Truth(setting, slopes, centre + rng.normal(0.0, _SCATTER_DB, setting.runs), rule.trials)
        quest = rule if isinstance(rule, QuestPlusRule) else rule.rule(_GUESS)
        return run_quests(quest, setting.runs, truth, rng), truth
    first = rule.build(_GUESS, Playable()).placement()
    if first is None:
        raise BadInput("a procedure that has no trial", "one with at least one")
    truth = _Truth(setting, slopes, zero + first.level_db_sl - setting.start_db, rule.typical_trials)
    return _run_each(rule, setting.runs, truth, rng), truth


def _run_each(procedure: ProcedureKeys, runs: int, probability: Probability, rng: np.random.Generator) -> Tracks:
    levels, correct, estimates = list[list[float]](), list[list[bool]](), np.full(runs, np.nan)
    for number in range(runs):
        run, at, mine = procedure.build(_GUESS, Playable()), list[float](), list[bool]()
        while (placement := run.placement()) is not None:
            chance = probability(np.array([placement.level_db_sl]), np.array([number]), len(at))
            at.append(placement.level_db_sl)
            mine.append(bool(rng.random() < chance[0]))
            run.record(mine[-1])
        estimate = run.estimate()
        if estimate is not None:
            estimates[number] = estimate.level_db_sl
        levels.append(at)
        correct.append(mine)
    trials = np.array([len(at) for at in levels])
    size = (runs, int(trials.max()))
    played, right = np.full(size, np.nan), np.zeros(size, dtype=np.bool_)
    for number, (at, mine) in enumerate(zip(levels, correct, strict=True)):
        played[number, : len(at)], right[number, : len(at)] = at, mine
    return Tracks(played, right, trials, estimates)


class _Truth:
    """Probability of a right answer of the observer of every run, whose thresholds drift over so many trials."""

    def __init__(self, setting: Setting, slopes: FloatArray, threshold: FloatArray, trials: float) -> None:
        self._model = Psychometric(Weibull(1.0), lapse=setting.lapse)
        self._setting, self._slopes, self._trials = setting, slopes, trials
        self.threshold = threshold

    def __call__(self, level_db: FloatArray, numbers: NDArray[np.intp], trial: NDArray[np.intp] | int) -> FloatArray:
        above = level_db - self.threshold[numbers] - self._setting.drifted_db(trial, self._trials)
        return self._setting.chance(self._model, above, self._slopes[numbers])


@dataclass(frozen=True)
class CurveQualityAt:
    """Quality of the curves at one frequency; coverage95: share of the people whose threshold the 95 % band holds."""

    frequency_hz: float
    rms_error_db: float
    coverage95: float


@dataclass(frozen=True)
class CurveQuality:
    """Quality of the curves at the frequencies that `thresholds` tells and exports.

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


def simulate_curve(
    rule: WholeCurveRule,
    setting: Setting,
    truth: RelativeCurve | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> CurveQuality:
    """Run the procedure on setting.runs observers and judge its curves.

    truth: everybody's curve; None: drawn from NORMAL_PEOPLE. setting.start_db has no meaning here. progress: called
    with the share that is done.
    """
    rng = np.random.default_rng(setting.seed)
    judged, names = [], list[tuple[str, ...]]()
    for first in range(0, setting.runs, _BATCH_RUNS):
        count = min(_BATCH_RUNS, setting.runs - first)
        part = _Batch(rule, setting, truth, count, rng)
        names += part.run(lambda share, done=first, more=count: progress((done + share * more) / setting.runs))  # type: ignore[misc]
        judged.append(part.judged())
    error, within, excluded = (np.concatenate(column) for column in zip(*judged, strict=True))
    rms, share = np.sqrt(np.mean(error**2, axis=0)).tolist(), within.mean(axis=0).tolist()
    return CurveQuality(
        rms_error_db=float(np.sqrt(np.mean(error**2))),
        bias_db=float(error.mean()),
        rms_error_median_db=float(np.median(np.sqrt(np.mean(error**2, axis=1)))),
        coverage95=float(within.mean()),
        **shares(names),
        trials=rule.trials,
        people="drawn: normal people near the procedure's own prior" if truth is None else truth.name,
        notch_excluded=float(excluded.mean()),
        by_frequency=tuple(map(CurveQualityAt, rule.prior.frequency_hz.tolist(), rms, share)),
    )


class _Batch:
    def __init__(
        self, rule: WholeCurveRule, setting: Setting, truth: RelativeCurve | None, runs: int, rng: np.random.Generator
    ) -> None:
        self._rule, self._setting, self._rng = rule, setting, rng
        frequency_hz = rule.prior.frequency_hz
        if truth is None:
            self._truth = NORMAL_PEOPLE.draw(frequency_hz, rule.prior.middle_hz, runs, rng)
        else:
            self._truth = np.broadcast_to(truth.level_db_sl_at(frequency_hz), (runs, frequency_hz.size))
        self._slope = rng.uniform(*setting.slope, runs)
        answering = rule.answering
        self._model = Psychometric(Weibull(1.0), answering.guess, setting.lapse, answering.target)
        self._beliefs = [CurveBelief(rule.prior, answering, runs)]

    def run(self, progress: Callable[[float], None]) -> list[tuple[str, ...]]:
        """Run all trials and return the flags that each run earns. progress: called with the share that is done."""
        rule, kept, belief = self._rule, [], self._beliefs[0]
        for trial in range(rule.trials):
            point, level = belief.choose(rule.floor_db_sl, rule.ceiling_db_sl)
            correct = self._answers(point[:, None], level[:, None], np.array([[trial]]))[:, 0]
            belief.learn(point, level, correct)
            kept.append((point, level, correct))
            progress((trial + 1) / rule.trials)
        belief.refine()
        trials = Trials(*(np.array(column).T for column in zip(*kept, strict=True)))
        if self._setting.loud_share:
            return self._with_loud(trials)
        flags = curve_flags(belief, trials)
        return [flags.names(run) for run in range(self._slope.size)]

    def _with_loud(self, placed: Trials) -> list[tuple[str, ...]]:
        """Learn every run anew with loud trials among the procedure's, as `thresholds` does, and return its flags."""
        order = with_loud_trials(
            np.full(self._slope.size, placed.level_db_sl.shape[1]), self._setting.loud_share, self._rng
        )
        points, levels = np.take_along_axis(placed.point, order.placed, axis=1), order.levels(placed.level_db_sl)
        correct = order.outcomes(placed.correct, self._answers(points, np.nan_to_num(levels), order.placed))
        self._beliefs, names = [], []
        for run, there in enumerate(order.there):
            belief = CurveBelief(self._rule.prior, self._rule.answering)
            mine = Trials(points[[run]][:, there], levels[[run]][:, there], correct[[run]][:, there])
            for point, level, right in zip(mine.point.T, mine.level_db_sl.T, mine.correct.T, strict=True):
                belief.learn(point, level, right)
            belief.refine()
            self._beliefs.append(belief)
            names.append((*curve_flags(belief, mine).names(), *order.attention(run, correct)))
        return names

    def _answers(self, point: NDArray[np.intp], level_db: FloatArray, trial: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return whether trials are answered rightly; arguments (runs, trials)."""
        threshold = np.take_along_axis(self._truth, point, axis=1)
        above = level_db - threshold - self._setting.drifted_db(trial, self._rule.trials)
        chance = self._setting.chance(self._model, above, self._slope[:, None])
        return np.asarray(self._rng.random(level_db.shape) < chance)

    def judged(self) -> tuple[FloatArray, NDArray[np.bool_], NDArray[np.bool_]]:
        """Return error, whether the band holds the truth and whether a notch is excluded, (runs, points) each."""
        curves, notches = [], []
        for belief in self._beliefs:
            curves.append(belief.curve(belief.prior.frequency_hz))
            notches.append(unseen_notch(belief).trials == 0)
        mean, low, high = (np.concatenate([getattr(each, name) for each in curves]) for name in ("mean", "low", "high"))
        return mean - self._truth, (low <= self._truth) & (self._truth <= high), np.concatenate(notches)


def simulate_kind(
    name: str,
    setting: Setting,
    trials: int | None = None,
    people: RelativeCurve | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Quality | CurveQuality:
    """Judge the kind of procedure of that name, of this package or another, with its own defaults.

    trials: of a run, None: as the kind has it. people: everybody's curve, for `curve` alone. progress: called with the
    share that is done, of `curve` alone. Raises BadInput for a kind that nobody declares, a number of trials where the
    kind has none, and people where it measures no curve.
    """
    kind = procedure_kind(name)
    if trials is not None and "trials" not in {key.name for key in fields(kind)}:
        raise BadInput(f"--trials {trials} with {name}", "with a procedure that has a number of trials")
    keys = kind(kind=name) if trials is None else kind(kind=name, trials=trials)  # type: ignore[call-arg]
    if isinstance(keys, CurveKeys):
        return simulate_curve(keys.rule(_GUESS, Playable()), setting, people, progress)
    if people is not None:
        raise BadInput(f"--truth with {name}", "with curve")
    return simulate(keys, setting)
