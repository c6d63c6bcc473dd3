"""Quality of a procedure in many simulated runs against a Weibull observer with a known threshold.

The loop of the display is not simulated. Levels are relative to the true threshold, where psi, lapses included, reaches
its target, so that estimates are errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.quest_plus import QuestPlusRule, run_quests
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.experiment.procedure.run_flags import run_flags
from tactuator.experiment.procedure.up_down import IMECE2004, Tracks, UpDownRule, run_tracks
from tactuator.experiment.result.played import inattentive
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.perception.psychometric import Psychometric, Weibull, weibull_rise

_ABOVE_DB = 20.0
"""Level of a loud trial above the procedure's next level, as protocols have it unless they say otherwise."""


@dataclass(frozen=True)
class WithLoud:
    """Order of all trials of several runs, each (runs, trials).

    own: index of the procedure's trial that is played or, at a loud trial, is next. loud: True at loud trials. there:
    False where a run was over.
    """

    own: NDArray[np.intp]
    loud: NDArray[np.bool_]
    there: NDArray[np.bool_]

    def levels(self, own_db: FloatArray, highest_db: FloatArray | float = COMFORT_DB_SL) -> FloatArray:
        """Return the level of every trial, NaN where a run was over; own_db: of the procedure's, (runs, own trials)."""
        level = np.take_along_axis(own_db, self.own, axis=1)
        return np.where(self.there, np.where(self.loud, np.minimum(level + _ABOVE_DB, highest_db), level), np.nan)

    def outcomes(self, own: NDArray[np.bool_], loud: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the outcome of every trial: the procedure's, (runs, own trials), or a loud one's, (runs, trials)."""
        found = np.where(self.loud, loud, np.take_along_axis(own, self.own, axis=1))
        return np.asarray(found & self.there)

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
    own = np.zeros((runs, int(total.max())), dtype=np.intp)
    loud = np.zeros(own.shape, dtype=np.bool_)
    for run in range(runs):
        order = np.repeat(np.arange(most), played[run])
        own[run, : total[run]] = order
        loud[run, : total[run] - 1] = order[1:] == order[:-1]
    return WithLoud(own, loud, np.arange(own.shape[1]) < total[:, None])


_START_ABOVE_EXPECTED_DB = 20.0
_SCATTER_DB = 5.0


@dataclass(frozen=True)
class Setting:
    """Settings of a simulation of runs.

    runs: their number. slope: range of Weibull slopes, (lowest, highest), from which each run's is drawn. lapse: lapse
    rate. start_db: level of the first trial above the truth. guessed: share of trials that are guessed outright (1:
    all). drift_db: rise of thresholds from the first trial to the last (of a run of typical length), about their mean.
    loud_share: of loud catch trials among all. Raises BadInput for values that cannot be.
    """

    runs: int
    slope: tuple[float, float] = (2.5, 2.5)
    lapse: float = 0.0
    start_db: float = 20.0
    seed: int = 0
    guessed: float = 0.0
    drift_db: float = 0.0
    loud_share: float = 0.0

    def __post_init__(self) -> None:
        if self.runs < 2:
            raise BadInput(f"{self.runs} runs", "2 or more")
        if not 0.0 < self.slope[0] <= self.slope[1]:
            raise BadInput(f"slope {self.slope[0]:g} to {self.slope[1]:g}", "positive, ascending")
        if not -40.0 <= self.start_db <= 60.0:
            raise BadInput(f"start {self.start_db:g} dB above the threshold", "-40 to 60")
        Psychometric(Weibull(self.slope[0]), lapse=self.lapse)
        if not (0.0 <= self.guessed <= 1.0 and abs(self.drift_db) <= 60.0 and 0.0 <= self.loud_share <= 0.5):
            raise BadInput(
                f"guess {self.guessed:g}, drift {self.drift_db:g} dB, loud share {self.loud_share:g}",
                "0 to 1, -60 to 60 dB, 0 to 0.5",
            )

    def drifted_db(self, trial: NDArray[np.intp] | int, trials: float) -> FloatArray:
        """Return how far above their mean thresholds are at a trial of a run of so many."""
        return self.drift_db * (np.asarray(trial) / max(trials - 1.0, 1.0) - 0.5)

    def chance(self, guess: float, felt: FloatArray) -> FloatArray:
        """Return the probability of a right answer where it is `felt` in trials that are not guessed outright."""
        return np.asarray(self.guessed * guess + (1.0 - self.guessed) * felt)


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


def simulate(procedure: UpDownRule | QuestPlusRule, setting: Setting) -> Quality:
    """Run the procedure `setting.runs` times and judge its estimates. Raises BadInput where no run comes to its end."""
    rng = np.random.default_rng(setting.seed)
    tracks, truth = _run(procedure, setting, rng)
    own = tracks.estimates_db_sl - truth.threshold
    own = own[np.isfinite(own)]
    if own.size < 2:
        raise BadInput("not one run came to its end", "a trial limit that lets runs end")
    levels, correct, loud = _with_loud(tracks, truth, setting, rng)
    again = refit(levels, correct, RefitPrior())
    error = again.threshold_db
    covered = (again.low_db <= 0.0) & (again.high_db >= 0.0)
    tests = run_flags(levels, correct, again, RefitPrior())
    low, high = np.percentile(tracks.trials, [5.0, 95.0])
    return Quality(
        bias_db=float(own.mean()),
        sd_db=float(own.std(ddof=1)),
        rmse_db=float(np.sqrt(np.mean(own**2))),
        trials_mean=float(tracks.trials.mean()),
        trials_p05=float(low),
        trials_p95=float(high),
        refit=RefitQuality(float(error.mean()), float(np.sqrt(np.mean(error**2))), float(covered.mean())),
        unfinished=setting.runs - own.size,
        **shares([(*tests.names(run), *loud.attention(run, correct)) for run in range(setting.runs)]),
    )


def shares(names: Sequence[tuple[str, ...]]) -> dict[str, Any]:
    """Return the share of runs with any flag and with each, from the names of each run's flags."""
    each = sorted({name for found in names for name in found})
    flags = {name: float(np.mean([name in found for found in names])) for name in each}
    return {"flagged": float(np.mean([bool(found) for found in names])), "flags": flags}


def _with_loud(
    tracks: Tracks, truth: _Truth, setting: Setting, rng: np.random.Generator
) -> tuple[FloatArray, NDArray[np.bool_], WithLoud]:
    """Return levels above the truth and outcomes of all trials, loud ones included, and their order."""
    order = with_loud_trials(tracks.trials, setting.loud_share, rng)
    levels = order.levels(tracks.levels_db_sl)
    numbers = np.broadcast_to(np.arange(setting.runs)[:, None], levels.shape)
    loud = rng.random(levels.shape) < truth(np.nan_to_num(levels), numbers, order.own)
    return levels - truth.threshold[:, None], order.outcomes(tracks.correct, loud), order


def run_procedure(procedure: UpDownRule | QuestPlusRule, setting: Setting) -> Tracks:
    """Run the procedure setting.runs times and return the tracks; levels and estimates are relative to the truth."""
    tracks, truth = _run(procedure, setting, np.random.default_rng(setting.seed))
    levels = tracks.levels_db_sl - truth.threshold[:, None]
    return Tracks(levels, tracks.correct, tracks.trials, tracks.estimates_db_sl - truth.threshold)


def _run(procedure: UpDownRule | QuestPlusRule, setting: Setting, rng: np.random.Generator) -> tuple[Tracks, _Truth]:
    """Return the tracks in dB SL, and the truths.

    A track of an up-down rule begins start_db above a truth at 0 dB SL. Truths of QUEST+ scatter about what the rule
    expects: an experimenter who starts a track start_db above the threshold expects the threshold
    _START_ABOVE_EXPECTED_DB below that start, so that the truth lies _START_ABOVE_EXPECTED_DB - start_db above what the
    rule expects, on average.
    """
    slopes = rng.uniform(*setting.slope, setting.runs)
    if isinstance(procedure, UpDownRule):
        truth = _Truth(setting, slopes, np.zeros(setting.runs), procedure.typical_trials)
        return run_tracks(procedure, np.full(setting.runs, setting.start_db), truth, rng), truth
    centre = procedure.expected_db_sl + _START_ABOVE_EXPECTED_DB - setting.start_db
    threshold = centre + rng.normal(0.0, _SCATTER_DB, setting.runs)
    truth = _Truth(setting, slopes, threshold, procedure.trials)
    return run_quests(procedure, setting.runs, truth, rng), truth


class _Truth:
    """Probability of a right answer of the observer of every run, whose thresholds drift over so many trials."""

    def __init__(self, setting: Setting, slopes: FloatArray, threshold: FloatArray, trials: float) -> None:
        self._model = Psychometric(Weibull(1.0), lapse=setting.lapse)
        self._setting, self._slopes, self._trials = setting, slopes, trials
        self.threshold = threshold

    def __call__(self, level_db: FloatArray, numbers: NDArray[np.intp], trial: NDArray[np.intp] | int) -> FloatArray:
        model, setting = self._model, self._setting
        above = level_db - self.threshold[numbers] - setting.drifted_db(trial, self._trials)
        rise = weibull_rise(above, self._slopes[numbers], model.at_threshold)
        return setting.chance(model.guess, model.guess + (1.0 - model.guess - model.lapse) * rise)


PROCEDURES: dict[str, UpDownRule] = {"imece2004": IMECE2004}
"""Rules of the procedures that have a name."""
