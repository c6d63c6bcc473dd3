"""Tests of a residual: its own colour, whiteness without it, and dependence on the command."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.signals.discretise import first_order

_LAGS, _BURST = 40, 50
"""Lags of the test of whiteness, and samples about the greatest innovation that may belong to it."""
CHANCE, _MISFIT = 1e-3, 0.01
"""Chance of a residual that follows the command so much, and its share that does, beyond which no loop is stated."""


@dataclass(frozen=True)
class Change:
    """How the response's logarithm changed along the records: at frequency_hz (m,), its deviation about the mean, (m,)
    complex, less what chance explains; greatest: the largest difference of magnitude beyond chance; place: record and
    middle sample of the part that departs most.
    """

    frequency_hz: FloatArray
    deviation: ComplexArray
    greatest: float
    place: tuple[int, int] | None = None

    def at(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the deviation at `frequency_hz` (any shape), straight between points of log frequency."""
        places = np.log(np.maximum(frequency_hz, 1e-300)), np.log(self.frequency_hz)
        real, imaginary = (np.interp(*places, part) for part in (self.deviation.real, self.deviation.imag))
        return np.asarray(real + 1j * imaginary)


NO_CHANGE = Change(np.ones(1), np.zeros(1, dtype=np.complex128), 0.0)


@dataclass(frozen=True)
class ResidualTests:
    """Chances (p) that a residual free of structure would look as bad; a test passes above 1 %.

    white: of the innovations (after the noise model). uncorrelated: with the command's past; unexplained: the share of
    the residual's power that the command's past explains. feedback: true where the command depends on the residual's
    past, false where it repeats itself without the noise, None where the record cannot tell; stated: it is known.
    knock: the greatest innovation over their usual size; jump: its sample, or None, in which part of the records.
    skew_ppm, drift: by how much the position's clock is slower, and by what part its gain rises along the record, each
    with its 95 % half-width. change: of the response along the records.
    """

    white_p: float
    uncorrelated_p: float
    unexplained: float
    feedback: bool | None = None
    stated: bool = False
    knock: float = 1.0
    jump: int | None = None
    part: int = 0
    skew_ppm: tuple[float, float] = (0.0, 0.0)
    drift: tuple[float, float] = (0.0, 0.0)
    change: Change = NO_CHANGE

    @property
    def is_misfit(self) -> bool:
        """Return whether so much of the residual follows the command that a loop cannot be recognised."""
        return self.uncorrelated_p < CHANCE and self.unexplained > _MISFIT

    @property
    def feedback_is(self) -> str:
        """Return whether there was feedback, and how that is known."""
        if self.feedback is None:
            return "unknown"
        return f"{'known' if self.stated else 'likely'}: {'yes' if self.feedback else 'no'}"

    @property
    def white(self) -> bool:
        """Return whether Ljung and Box's test passed."""
        return self.white_p > 0.01

    @property
    def uncorrelated_with_input(self) -> bool:
        """Return whether the command's past explains nothing of the residual."""
        return self.uncorrelated_p > 0.01


def jump_of(innovation: FloatArray) -> tuple[float, int | None]:
    """Return the greatest of innovations (n,) over their usual size, and where it is: a knock, a lost block, or a seam
    between two runs; 1 and None where many are as large.
    """
    size = np.abs(innovation)
    usual = float(np.median(size)) / 0.6745
    if usual <= 0.0:
        return 1.0, None
    at, knock = int(np.argmax(size)), float(size.max()) / usual
    near = np.abs(np.arange(size.size) - at) <= _BURST
    often = float(np.mean(size[~near] > 0.5 * knock * usual)) if not np.all(near) else 1.0
    return (knock, at) if often < 1e-3 else (1.0, None)


def check_residual(innovation: FloatArray, command: FloatArray, jacobian: FloatArray, rate_hz: float) -> ResidualTests:
    """Test a residual. innovation (n,): whitened residual; command (n,), whitened alike; jacobian (n, p) of the
    estimated parameters.
    """
    p_white = _ljung_box(innovation)
    p_input, share = _input_test(innovation, command, jacobian, rate_hz)
    return ResidualTests(p_white, p_input, share)


def _ljung_box(values: FloatArray) -> float:
    """Test whiteness by Ljung and Box (1978): n (n + 2) sum r_k^2 / (n - k) is chi-squared, a degree for each lag."""
    n, lags = values.size, min(_LAGS, values.size // 10)
    covariance = autocorrelation(values - values.mean(), lags)
    if covariance[0] == 0.0:
        return 1.0
    r = covariance[1:] / covariance[0]
    statistic = n * (n + 2.0) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    return float(scipy.special.chdtrc(lags, statistic))


def _input_test(
    innovation: FloatArray, command: FloatArray, jacobian: FloatArray, rate_hz: float
) -> tuple[float, float]:
    """Score test: does the command's past, seen through low-pass filters of every time scale, explain the residual?

    Lags even in time would need hundreds of thousands to see a slow error; time constants even in log time see all.
    """
    n = innovation.size
    system = np.vstack([jacobian.T, time_scales(command, rate_hz)])
    gram = system @ system.T
    if not np.all(np.isfinite(gram)):
        return 0.0, 1.0  # the model's slopes overflow: nothing speaks for such a model
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    gram = gram / np.outer(size, size)
    goal = system @ innovation / size
    p = jacobian.shape[1]
    total, rank = _explained(gram, goal)
    known, own_rank = _explained(gram[:p, :p], goal[:p])
    variance = float(innovation @ innovation) / n
    if variance <= 0.0 or rank <= own_rank:
        return 1.0, 0.0
    gained = max(total - known, 0.0)
    return float(scipy.special.chdtrc(rank - own_rank, gained / variance)), gained / (n * variance)


def time_scales(command: FloatArray, rate_hz: float) -> FloatArray:
    """Return first-order low-passes of the delayed command, corners from 2 record periods to 0.2 rate, (k, n)."""
    corners = np.geomspace(2.0 * rate_hz / command.size, 0.2 * rate_hz, 14)
    late = np.concatenate([[0.0], command[:-1] - command.mean()])
    decays = np.exp(-2.0 * np.pi * corners / rate_hz)
    return np.array([first_order(decay, (1.0 - decay) * late) for decay in decays])


def _explained(gram: FloatArray, goal: FloatArray) -> tuple[float, int]:
    if not gram.size:
        return 0.0, 0
    values, vectors = np.linalg.eigh(gram)
    kept = values > 1e-9 * values[-1]
    turned = vectors.T @ goal
    return float(np.sum(turned[kept] ** 2 / values[kept])), int(kept.sum())


def autocorrelation(values: FloatArray, lags: int) -> FloatArray:
    """Return the biased autocovariance at lags 0 .. lags of `values` (n,), shape (lags + 1,)."""
    size = 1 << int(np.ceil(np.log2(values.size + lags + 1)))
    spectrum = np.abs(np.fft.rfft(values, size)) ** 2
    return np.asarray(np.fft.irfft(spectrum, size)[: lags + 1] / values.size)


def whitening_filter(residual: FloatArray, highest_order: int) -> FloatArray:
    """Return the coefficients 1, h1, .. hp of the prediction-error filter of `residual` (n,), p by Akaike's criterion.

    p = 0 (white) gives [1].
    """
    order = min(highest_order, residual.size // 50)
    covariance = autocorrelation(residual - residual.mean(), order)
    if covariance[0] <= 0.0:
        return np.ones(1)
    best, best_score = np.ones(1), residual.size * np.log(covariance[0])
    for filtered, error in prediction_filters(covariance):
        score = residual.size * np.log(error) + 2.0 * (filtered.size - 1)
        if score < best_score - 4.0:
            best, best_score = filtered, score
    return best


def prediction_filters(covariance: FloatArray) -> Iterator[tuple[FloatArray, float]]:
    """Yield the prediction-error filters 1, h1, .. hp of orders p from 0 on for an autocovariance (n,), and the power
    that each leaves, as long as there is any: Levinson and Durbin's recursion.
    """
    filtered, error = np.ones(1), float(covariance[0])
    for p in range(1, covariance.size + 1):
        yield filtered, error
        if p == covariance.size:
            break
        reflection = -float(filtered @ covariance[p:0:-1]) / error
        padded = np.append(filtered, 0.0)
        filtered = padded + reflection * padded[::-1]
        error *= 1.0 - reflection**2
        if not error > 1e-14 * covariance[0]:
            break


def apply_filter(coefficients: FloatArray, values: FloatArray) -> FloatArray:
    """Return `values` (n,) through the filter, no longer than they are, from rest."""
    size = scipy.fft.next_fast_len(values.size + coefficients.size - 1, real=True)
    return np.asarray(np.fft.irfft(np.fft.rfft(values, size) * np.fft.rfft(coefficients, size), size)[: values.size])
