"""Quality of a procedure in many simulated runs against a Weibull observer with a known threshold.

The loop of the display is not simulated. Levels are relative to the true threshold, where psi, lapses included, reaches
its target, so that estimates are errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.procedure.quest_plus import QuestPlusRule
from tactuator.experiment.procedure.quest_plus_batch import run_quests
from tactuator.experiment.procedure.refit import RefitPrior, refit
from tactuator.experiment.procedure.up_down import IMECE2004, UpDownRule
from tactuator.experiment.procedure.up_down_batch import Tracks, run_tracks
from tactuator.perception.psychometric import Psychometric, Weibull, weibull_rise

_START_ABOVE_EXPECTED_DB = 20.0
_SCATTER_DB = 5.0


@dataclass(frozen=True)
class Setting:
    """Settings of a simulation of runs.

    runs: their number. slope: range of Weibull slopes, (lowest, highest), from which each run's is drawn. lapse: lapse
    rate. start_db: level of the first trial above the truth. Raises BadInput for values that cannot be.
    """

    runs: int
    slope: tuple[float, float] = (2.5, 2.5)
    lapse: float = 0.0
    start_db: float = 20.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.runs < 2:
            raise BadInput(f"{self.runs} runs; allowed: 2 or more")
        if not 0.0 < self.slope[0] <= self.slope[1]:
            raise BadInput(f"slope {self.slope[0]:g} to {self.slope[1]:g}; allowed: positive, ascending")
        if not -40.0 <= self.start_db <= 60.0:
            raise BadInput(f"start {self.start_db:g} dB above the threshold; allowed: -40 to 60")
        Psychometric(Weibull(self.slope[0]), lapse=self.lapse)


@dataclass(frozen=True)
class RefitQuality:
    """Quality of the Bayesian refit of the same trials; coverage95: share of 95 % intervals that hold the truth."""

    bias_db: float
    rmse_db: float
    coverage95: float


@dataclass(frozen=True)
class Quality:
    """Quality of the procedure's own estimate; unfinished: number of runs that reached the trial limit without one."""

    bias_db: float
    sd_db: float
    rmse_db: float
    trials_mean: float
    trials_p05: float
    trials_p95: float
    refit: RefitQuality
    unfinished: int = 0


def simulate(procedure: UpDownRule | QuestPlusRule, setting: Setting) -> Quality:
    """Run the procedure `setting.runs` times and judge its estimates. Raises BadInput where no run comes to its end."""
    tracks = run_procedure(procedure, setting)
    own = tracks.estimates_db_sl[np.isfinite(tracks.estimates_db_sl)]
    if own.size < 2:
        raise BadInput("not one run came to its end; allowed: a trial limit that lets runs end")
    again = refit(tracks.levels_db_sl, tracks.correct, RefitPrior())
    error = again.threshold_db
    covered = (again.low_db <= 0.0) & (again.high_db >= 0.0)
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
    )


def run_procedure(procedure: UpDownRule | QuestPlusRule, setting: Setting) -> Tracks:
    """Run the procedure setting.runs times and return the tracks; levels and estimates are relative to the truth."""
    return _up_down(procedure, setting) if isinstance(procedure, UpDownRule) else _quest_plus(procedure, setting)


def _up_down(rule: UpDownRule, setting: Setting) -> Tracks:
    rng = np.random.default_rng(setting.seed)
    slopes = _slopes(setting, rng)
    return run_tracks(
        rule, np.full(setting.runs, setting.start_db), _Truth(slopes, setting.lapse, np.zeros(setting.runs)), rng
    )


def _quest_plus(rule: QuestPlusRule, setting: Setting) -> Tracks:
    """Run QUEST+ against truths that scatter about what the rule expects.

    An experimenter who starts a track start_db above the threshold expects the threshold _START_ABOVE_EXPECTED_DB below
    that start. The truth therefore lies _START_ABOVE_EXPECTED_DB - start_db above what the rule expects, on average.
    """
    rng = np.random.default_rng(setting.seed)
    slopes = _slopes(setting, rng)
    centre = rule.expected_db_sl + _START_ABOVE_EXPECTED_DB - setting.start_db
    truth = centre + rng.normal(0.0, _SCATTER_DB, setting.runs)
    tracks = run_quests(rule, setting.runs, _Truth(slopes, setting.lapse, truth), rng)
    levels = tracks.levels_db_sl - truth[:, None]
    return Tracks(levels, tracks.correct, tracks.trials, tracks.estimates_db_sl - truth)


def _slopes(setting: Setting, rng: np.random.Generator) -> FloatArray:
    return rng.uniform(*setting.slope, setting.runs)


class _Truth:
    """Probability of a right answer of the observer of every run."""

    def __init__(self, slopes: FloatArray, lapse: float, threshold: FloatArray) -> None:
        model = Psychometric(Weibull(1.0), lapse=lapse)
        self._guess, self._lapse, self._at_threshold = model.guess, lapse, model.at_threshold
        self._slopes, self._threshold = slopes, threshold

    def __call__(self, level_db: FloatArray, numbers: NDArray[np.intp]) -> FloatArray:
        rise = weibull_rise(level_db - self._threshold[numbers], self._slopes[numbers], self._at_threshold)
        return np.asarray(self._guess + (1.0 - self._guess - self._lapse) * rise)


PROCEDURES: dict[str, UpDownRule] = {"imece2004": IMECE2004}
"""Rules of the procedures that have a name."""
