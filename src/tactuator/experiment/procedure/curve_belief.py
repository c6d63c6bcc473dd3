"""What is believed of a threshold curve between trials, and where the next trial tells most.

One Gaussian over the curve's points for each psychometric slope that is thought possible. A response changes it
by moment matching (assumed-density filtering; Minka 2001): the marginal at the trial's frequency is multiplied by psi,
its mean and variance are taken by quadrature, and the rest of the curve follows by its covariance. The next trial is
the one that is expected to take most off the variance of the whole curve. Many runs at once; one run is a batch of one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactuator.experiment.procedure.curve_prior import CurvePrior
from tactuator.perception.psychometric import TARGET_3_DOWN_1_UP, weibull_rise

Floats = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(11)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


@dataclass(frozen=True)
class Answering:
    """How people answer: slopes thought equally possible, lapse rate, guess rate; offsets_db: levels worth trying,

    relative to the present estimate at each frequency.
    """

    slopes: tuple[float, ...] = (1.3, 1.8, 2.4, 3.2)
    lapse: float = 0.02
    guess: float = 1.0 / 3.0
    target: float = TARGET_3_DOWN_1_UP
    offsets_db: tuple[float, ...] = (-6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0, 8.0, 11.0, 14.0)

    def psi(self, level_db: Floats, slope: Floats) -> Floats:
        """Probability of a correct response at level_db re threshold."""
        at_threshold = (self.target - self.guess) / (1.0 - self.guess - self.lapse)
        return np.asarray(self.guess + (1.0 - self.guess - self.lapse) * weibull_rise(level_db, slope, at_threshold))


@dataclass
class CurveBelief:
    """mean: (runs, slopes, points) dB SL; covariance: (runs, slopes, points, points); log_weight: (runs, slopes)."""

    prior: CurvePrior
    answering: Answering
    runs: int = 1
    mean: Floats = field(init=False)
    covariance: Floats = field(init=False)
    log_weight: Floats = field(init=False)

    def __post_init__(self) -> None:
        frequency_hz = self.prior.frequency_hz
        slopes, points = len(self.answering.slopes), frequency_hz.size
        self.mean = np.zeros((self.runs, slopes, points))
        start = self.prior.covariance(frequency_hz, frequency_hz)
        self.covariance = np.broadcast_to(start, (self.runs, slopes, points, points)).copy()
        self.log_weight = np.zeros((self.runs, slopes))

    @property
    def weight(self) -> Floats:
        """Probability of each slope, (runs, slopes)."""
        relative = np.exp(self.log_weight - self.log_weight.max(axis=1, keepdims=True))
        return np.asarray(relative / relative.sum(axis=1, keepdims=True))

    def curve(self) -> tuple[Floats, Floats]:
        """Mean (runs, points) and covariance (runs, points, points) with the slope integrated out."""
        weight = self.weight
        mean = np.einsum("rk,rkg->rg", weight, self.mean)
        apart = self.mean - mean[:, None, :]
        spread = self.covariance + apart[..., :, None] * apart[..., None, :]
        return mean, np.einsum("rk,rkgh->rgh", weight, spread)

    def choose(self, floor_db_sl: float, ceiling_db_sl: float) -> tuple[NDArray[np.intp], Floats]:
        """Point and level (half dB) of the most telling trial of every run, (runs,) each."""
        mean = np.einsum("rk,rkg->rg", self.weight, self.mean)
        levels = np.round(2.0 * (mean[:, :, None] + np.array(self.answering.offsets_db))) / 2.0
        levels = np.clip(levels, floor_db_sl, ceiling_db_sl)
        gain = self._expected_gain(levels).reshape(self.runs, -1)
        best = np.argmax(gain, axis=1)
        point = best // levels.shape[2]
        return point, levels[np.arange(self.runs), point, best % levels.shape[2]]

    def _expected_gain(self, levels: Floats) -> Floats:
        """Expected fall of the curve's summed variance, (runs, points, levels)."""
        variance = np.einsum("rkgg->rkg", self.covariance)
        slopes = np.array(self.answering.slopes)[None, :, None, None, None]
        threshold = self.mean[..., None] + np.sqrt(variance)[..., None] * _NODES
        psi = self.answering.psi(levels[:, None, :, :, None] - threshold[:, :, :, None, :], slopes)
        right, tilted, squared = psi @ _WEIGHTS, psi @ (_WEIGHTS * _NODES), psi @ (_WEIGHTS * _NODES**2)
        wrong = 1.0 - right
        left = squared - tilted**2 / right + (1.0 - squared) - tilted**2 / wrong
        reach = np.einsum("rkgh,rkgh->rkh", self.covariance, self.covariance) / variance
        return np.asarray(np.einsum("rk,rkgx->rgx", self.weight, (1.0 - left) * reach[..., None]))

    def learn(self, point: NDArray[np.intp], level_db_sl: Floats, correct: NDArray[np.bool_]) -> None:
        """A trial of every run; arguments (runs,)."""
        rows = np.arange(self.runs)
        sd = np.sqrt(self.covariance[rows, :, point, point])
        threshold = self.mean[rows, :, point][..., None] + sd[..., None] * _NODES
        slopes = np.array(self.answering.slopes)[None, :, None]
        psi = self.answering.psi(level_db_sl[:, None, None] - threshold, slopes)
        likelihood = np.where(correct[:, None, None], psi, 1.0 - psi)
        evidence = likelihood @ _WEIGHTS
        shift = likelihood @ (_WEIGHTS * _NODES) / evidence
        left = likelihood @ (_WEIGHTS * _NODES**2) / evidence - shift**2
        along = self.covariance[rows, :, :, point] / sd[..., None]
        self.log_weight = self.log_weight + np.log(evidence)
        self.mean = self.mean + along * shift[..., None]
        self.covariance = self.covariance - along[..., :, None] * along[..., None, :] * (1.0 - left)[..., None, None]
