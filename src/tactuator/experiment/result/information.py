"""Information transfer: how much of what was presented is known from what was answered.

IT = sum over i, j of (n_ij / n) log2(n_ij n / (n_i n_j)), in bits a stimulus; 2^IT categories are reliably told apart.
Counted from few trials it comes out too high, and every correction fails somewhere, so several are given side by side.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.language.words import Words, shipped_words
from tactuator.experiment.result.confusion_posterior import information_draws

ESTIMATORS = ("plug_in", "miller_madow", "all_cells", "error_rule")
"""Estimators that are numbers alone. plug_in: the sum above. miller_madow: less its first-order bias, from the cells,
rows and columns that are occupied (Miller 1955). all_cells: less (k - 1)^2 / (2 n ln 2), the same bias with every cell
counted. error_rule: (1 - 2 e) log2 k, e the share of errors (Tan et al. 1999)."""

POSTERIOR = "posterior"
"""The estimate with an interval: median of the posterior of confusion_posterior."""

TRIALS_PER_CELL_MIN = 5
"""Trials for each cell below which estimates are not to be relied on: n >= 5 k^2 (Miller 1955)."""


_INTERVAL_FACTORS = (1.15, 1.15)
"""Reach of the interval, downwards and upwards, over that of the posterior: with 1, the worst of the ways to err was
covered 0.83."""
_INTERVAL_FACTORS_FEW = (1.0, 1.3)
"""The same where a stimulus has fewer trials than there are stimuli, so that the prior of the spread weighs more. With
39 stimuli of 20 trials each the truth lies above where errors gather at neighbours (0.09 of 100 runs with 1.25, 0.06
with 1.3), and below where they are even (0.04 of 200)."""


@dataclass(frozen=True)
class InformationEstimate:
    """An estimate in bits, and its interval of the stated confidence; the interval is None where it would not be
    trusted.
    """

    bits: float
    low_bits: float | None = None
    high_bits: float | None = None

    @property
    def categories(self) -> float:
        """Return the number of items that are told apart without error: 2^bits."""
        return float(2.0**self.bits)


@dataclass(frozen=True)
class Reason:
    """A reason for caution: its text is that of key in the table [results] of a language, with the values put in."""

    key: str
    values: dict[str, str] = field(default_factory=dict)

    def told(self, words: Words) -> str:
        """Return the reason in these words."""
        return words(f"results.{self.key}", **self.values)


@dataclass(frozen=True, eq=False)
class Information:
    """Information transfer of a confusion matrix.

    estimates: by name, as in ESTIMATORS, and POSTERIOR. bits_per_second: by name, where the time that a stimulus takes
    is known. warning: None or one line. no_interval: None, or the reason why the estimates have no interval. reasons:
    both of these where they are there, for texts in other languages.
    """

    stimuli: int
    responses: int
    trials: int
    share_correct: float
    confidence: float
    estimates: dict[str, InformationEstimate]
    bits_per_second: dict[str, float] | None
    warning: str | None
    no_interval: str | None = None
    reasons: tuple[Reason, ...] = ()


def confusion_counts(matrix: ArrayLike) -> NDArray[np.int64]:
    """Return a confusion matrix (stimuli, responses) as whole counts, stimuli that were never presented left out.

    Raises BadInput for a matrix that is not of two dimensions, or holds anything but whole numbers of zero or more, or
    in which fewer than two stimuli were presented.
    """
    values = np.asarray(matrix, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] < 2:
        raise BadInput(f"confusion matrix has shape {values.shape}", "(stimuli, responses), two or more of each")
    if not np.all(np.isfinite(values)) or np.any(values < 0.0) or np.any(values != np.round(values)):
        raise BadInput("confusion matrix holds a number that is not a count", "0, 1, 2, ...")
    presented = values.sum(axis=1) > 0.0
    if presented.sum() < 2:
        raise BadInput(f"confusion matrix: {presented.sum()} stimuli were presented", "two or more")
    return values.astype(np.int64)


def plug_in_bits(counts: NDArray[np.int64]) -> FloatArray:
    """Return the plug-in estimate of matrices (..., stimuli, responses), shape (...)."""
    n = counts.sum(axis=(-2, -1))
    cells = _n_log_n(counts).sum(axis=(-2, -1))
    rows = _n_log_n(counts.sum(axis=-1)).sum(axis=-1)
    columns = _n_log_n(counts.sum(axis=-2)).sum(axis=-1)
    return np.asarray((cells - rows - columns + _n_log_n(n)) / n)


def miller_madow_bits(counts: NDArray[np.int64]) -> FloatArray:
    """Return plug-in less (cells - rows - columns + 1) / (2 n ln 2), counting those that are occupied; shape (...)."""
    cells = (counts > 0).sum(axis=(-2, -1))
    rows = (counts.sum(axis=-1) > 0).sum(axis=-1)
    columns = (counts.sum(axis=-2) > 0).sum(axis=-1)
    return np.asarray(plug_in_bits(counts) - (cells - rows - columns + 1) / (2.0 * _trials(counts) * np.log(2.0)))


def all_cells_bits(counts: NDArray[np.int64]) -> FloatArray:
    """Return plug-in less (stimuli - 1)(responses - 1) / (2 n ln 2); shape (...)."""
    stimuli, responses = _stimuli(counts), counts.shape[-1]
    return np.asarray(plug_in_bits(counts) - (stimuli - 1) * (responses - 1) / (2.0 * _trials(counts) * np.log(2.0)))


def error_rule_bits(counts: NDArray[np.int64]) -> FloatArray:
    """Return (1 - 2 e) log2 k, at least zero; shape (...). NaN where responses are not those of the stimuli."""
    if counts.shape[-1] != counts.shape[-2]:
        return np.full(counts.shape[:-2], np.nan)
    errors = 1.0 - np.trace(counts, axis1=-2, axis2=-1) / _trials(counts)
    return np.asarray(np.maximum(0.0, (1.0 - 2.0 * errors) * np.log2(_stimuli(counts))))


def all_estimates(counts: NDArray[np.int64]) -> dict[str, FloatArray]:
    """Return every estimator of ESTIMATORS on matrices (..., stimuli, responses), each of shape (...)."""
    functions = (plug_in_bits, miller_madow_bits, all_cells_bits, error_rule_bits)
    return {name: function(counts) for name, function in zip(ESTIMATORS, functions, strict=True)}


def information(
    matrix: ArrayLike,
    rng: np.random.Generator,
    *,
    seconds_per_stimulus: float | None = None,
    draws: int = 1000,
    confidence: float = 0.95,
) -> Information:
    """Return the information transfer of a confusion matrix (stimuli, responses) of counts.

    Only the posterior's median has an interval: intervals of the other estimates missed the truth (a bootstrap's covers
    the bias of its estimator and not the truth). It is refused where trials are too few for the number of stimuli, and
    where responses are not those of the stimuli. Raises BadInput for a matrix, confidence or number of draws that is
    not allowed.
    """
    counts = confusion_counts(matrix)
    if not 0.0 < confidence < 1.0 or draws < 100:
        raise BadInput(f"confidence {confidence:g}, {draws} draws", "between 0 and 1, and 100 or more")
    if seconds_per_stimulus is not None and not seconds_per_stimulus > 0.0:
        raise BadInput(f"{seconds_per_stimulus:g} seconds a stimulus", "a positive number")
    estimates = {name: InformationEstimate(float(bits)) for name, bits in all_estimates(counts).items()}
    why = _no_interval(counts)
    if why is None:
        estimates[POSTERIOR] = _posterior(counts, rng, draws, confidence)
    per_second = None
    if seconds_per_stimulus is not None:
        per_second = {name: estimate.bits / seconds_per_stimulus for name, estimate in estimates.items()}
    few, english = _few_trials(counts), shipped_words("en")
    trials, square = int(counts.sum()), counts.shape[0] == counts.shape[1]
    return Information(
        stimuli=int(_stimuli(counts)),
        responses=counts.shape[1],
        trials=trials,
        share_correct=float(np.trace(counts) / trials) if square else float("nan"),
        confidence=confidence,
        estimates=estimates,
        bits_per_second=per_second,
        warning=None if few is None else few.told(english),
        no_interval=None if why is None else why.told(english),
        reasons=tuple(one for one in (few, why) if one is not None),
    )


def _posterior(
    counts: NDArray[np.int64], rng: np.random.Generator, draws: int, confidence: float
) -> InformationEstimate:
    """Return the posterior's median with an interval somewhat wider than the posterior's own."""
    found = information_draws(counts, draws, rng)
    few = float(_trials(counts)) < counts.shape[0] ** 2
    down, up = _INTERVAL_FACTORS_FEW if few else _INTERVAL_FACTORS
    tails = (0.5 - 0.5 * confidence, 0.5, 0.5 + 0.5 * confidence)
    low, middle, high = (float(value) for value in np.quantile(found, tails))
    most = float(np.log2(counts.shape[0]))
    return InformationEstimate(
        middle,
        max(middle - down * (middle - low), 0.0),
        min(middle + up * (high - middle), most),
    )


def _no_interval(counts: NDArray[np.int64]) -> Reason | None:
    """Return why there is no interval, or None where there is one."""
    if counts.shape[0] != counts.shape[1]:
        return Reason("other_responses")
    if np.any(counts.sum(axis=1) == 0):
        return Reason("never_presented")
    each, wanted = float(_trials(counts)) / counts.shape[0], 0.5 * counts.shape[0]
    if each < wanted:
        values = {"each": f"{each:.3g}", "wanted": f"{wanted:g}", "stimuli": str(counts.shape[0])}
        return Reason("few_each", values)
    return None


def _few_trials(counts: NDArray[np.int64]) -> Reason | None:
    stimuli, responses, trials = int(_stimuli(counts)), counts.shape[1], int(counts.sum())
    wanted = TRIALS_PER_CELL_MIN * stimuli * responses
    if trials >= wanted:
        return None
    values = {"trials": trials, "stimuli": stimuli, "responses": responses, "wanted": wanted}
    return Reason("few_trials", {name: str(value) for name, value in values.items()})


def _n_log_n(counts: NDArray[np.int64]) -> FloatArray:
    values = np.asarray(counts, dtype=np.float64)
    return np.asarray(values * np.log2(np.where(values > 0.0, values, 1.0)))


def _trials(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray(counts.sum(axis=(-2, -1)))


def _stimuli(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray((counts.sum(axis=-1) > 0).sum(axis=-1))
