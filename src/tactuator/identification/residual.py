"""The residual that a fit leaves of the record itself, and what it shows of a loop, of the hold and of saturation.

In a loop the command follows the noise. A model that answers the command at once, or before it, then takes for an
answer what the noise did to the command, and the likelihood of the position given the command favours it wrongly. The
likelihood of both signals does not: to the position's it adds that of the command given the residual, which a loop's
filter can only follow causally (identifiability in a loop: Soderstrom and Stoica, System Identification, 1989,
chapter 10).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.data import mean_of_lines
from tactuator.identification.form import freedom
from tactuator.identification.hold import Hold, edge_lines, transient_columns
from tactuator.identification.likelihood import SpectralFit, SpectralProblem, fitted_beside
from tactuator.identification.lines import HIGHEST, Equations, Spectrum, equation_slices, equations_of, weights
from tactuator.identification.residual_tests import (
    ResidualTests,
    apply_filter,
    check_residual,
    jump_of,
    prediction_filters,
    time_scales,
    whitening_filter,
)
from tactuator.identification.search import Choice
from tactuator.identification.uncertainty import log_slopes, response_on
from tactuator.model.plant_model import Z95


@dataclass(frozen=True, eq=False)
class Residual:
    """A fit's residual. lines: of position minus model and transient, zero first; weight: one over their noise's
    deviation; response: the fit's on the lines but zero, hold included, position shifted; taken: the record's lines.
    """

    lines: ComplexArray
    weight: FloatArray
    response: ComplexArray
    taken: Spectrum

    @cached_property
    def simulated(self) -> FloatArray:
        """Return the samples of model and transient, (n,)."""
        return self.taken.measured - self.taken.samples_of(self.lines)


def fit_percent(measured: FloatArray, simulated: FloatArray) -> float:
    """Return 100 (1 - |y - simulated| / |y|) of positions without mean, (n,)."""
    spread = float(np.linalg.norm(measured))
    return 100.0 * (1.0 - float(np.linalg.norm(simulated - measured)) / spread) if spread > 0.0 else 0.0


def record_residual(choice: Choice, spectra: Sequence[Spectrum]) -> tuple[Residual, ...]:
    """Return the residual of the chosen fit on the lines of every record that it was fitted to."""
    given, weight = choice.problem.given, choice.problem.weight
    pieces = zip(given.parts, equation_slices(given), spectra, strict=True)
    return tuple(line_residual(choice.fit, part, weight[piece], taken) for part, piece, taken in pieces)


def choice_of_model(fit: SpectralFit, spectra: Sequence[Spectrum], highest_hz: float) -> Choice:
    """Return a model on records that it was not fitted to, their lines weighted by what it leaves up to highest_hz."""
    given = equations_of(spectra)
    grid = replace(fit.grid, frequency_hz=given.frequency_hz, rate_hz=given.rate_hz, shift=given.shift)
    flat = SpectralProblem(given, np.where(given.of_hz <= highest_hz, 1.0, 0.0), grid)
    problem, here = replace(flat, weight=weights(given, flat.residual(fit), highest_hz)), replace(fit, grid=grid)
    return Choice(grid.hold, here, {fit.form: here}, problem)


def residuals_of_model(fit: SpectralFit, spectra: Sequence[Spectrum], highest_hz: float) -> tuple[Residual, ...]:
    """Return what a model leaves of records that it was not fitted to."""
    return record_residual(choice_of_model(fit, spectra, highest_hz), spectra)


def check_record_residual(
    command: FloatArray, of_lines: Residual, fit: SpectralFit, *, fitted: bool = True, in_loop: bool = False
) -> ResidualTests:
    """Return the tests of what the fit leaves of a record; command: (n,), all; fitted: did it take part in it? in_loop:
    may the command have followed what disturbed before?
    """
    taken, residual = of_lines.taken, of_lines.taken.measured - of_lines.simulated
    grown = _growing_factor(fit, taken.rate_hz)  # a growing pole's noise is predicted, too
    if in_loop:
        # a step at the record's ends, up to 90 innovations high, is no colour of the noise
        within = apply_filter(grown, residual)[_ENDS:-_ENDS]
        own = whitening_filter(within * scipy.signal.windows.tukey(within.size, _TAPER), _LONG)
    else:
        own = whitening_filter(apply_filter(grown, residual), _SHORT)
    whitener = np.convolve(own, grown)
    skip = whitener.size + 1
    tested = slice(skip, skip + _TESTED)
    innovation = apply_filter(whitener, residual)[skip:]
    moved = apply_filter(whitener, command[: residual.size])[tested]
    slopes = np.zeros((moved.size, 0))
    if fitted:
        # around the record's ends the filter turns in a circle, no farther than what is left out before the tests
        white = np.fft.rfft(whitener, taken.samples)[1:] * of_lines.response * taken.command[1:]
        free = log_slopes(fit, taken.frequency_hz[1:])
        free = free @ freedom(fit.theta, fit.form, fit.stages) if fit.form.gain is not None else free
        lines = np.zeros((free.shape[1], taken.command.size), dtype=np.complex128)
        np.multiply(free.T, white, out=lines[:, 1:])
        slopes = np.fft.irfft(lines, taken.samples)[:, tested].T
        if grown.size > 1 and fit.form.gain is None:
            # the factor moves with the pole: without that, a slope would know of the noise to come
            for k, turned in enumerate(_growing_slopes(fit, taken.rate_hz), fit.numerator.size):
                slopes[:, k] -= apply_filter(np.convolve(own, turned), residual)[tested]
    if in_loop:  # what the innovation's own past explains is not the command's
        slopes = np.hstack([slopes, time_scales(innovation[:_TESTED], taken.rate_hz).T])
    tests = check_residual(innovation[:_TESTED], moved, slopes, taken.rate_hz)
    knock, jump = jump_of(innovation)
    jump = None if jump is None else jump + skip + taken.shift
    feedback = None if tests.is_misfit else feedback_seen(of_lines, fit.grid.hold)
    return replace(tests, feedback=feedback, knock=knock, jump=jump)


def _growing_factor(fit: SpectralFit, rate_hz: float) -> FloatArray:
    """Return the factor of the sampled denominator that has the growing poles, (1 + growing,)."""
    poles = fit.poles_rad_s
    return np.atleast_1d(np.poly(np.exp(poles[poles.real > 0.0] / rate_hz))).real


def _growing_slopes(fit: SpectralFit, rate_hz: float) -> Iterator[FloatArray]:
    """Yield the change of that factor by each of theta, (1 + growing,)."""
    for k in range(fit.theta.size):
        step = np.zeros(fit.theta.size)
        step[k] = 1e-6 * max(abs(float(fit.theta[k])), 1e-9)
        ahead = _growing_factor(replace(fit, theta=fit.theta + step), rate_hz)
        yield (ahead - _growing_factor(fit, rate_hz)) / step[k]


def line_residual(fit: SpectralFit, given: Equations, weight: FloatArray, taken: Spectrum) -> Residual:
    """Return the residual of a fit on all lines of one record, the transient solved for on its weighted equations."""
    grid = taken.grid.like(fit.grid.scale_rad_s, fit.grid.hold)
    response = response_on(fit, grid) * taken.ahead if taken.shift else response_on(fit, grid)
    moved = response * taken.command[1:]
    there = replace(fit.grid, frequency_hz=given.frequency_hz, rate_hz=given.rate_hz, shift=given.shift)
    columns = given.transient_of(transient_columns(there, fit.theta, fit.form), ends=True)
    held = response_on(fit, there)
    weights = fitted_beside(columns, given.goal - given.response_of(held[:, None])[:, 0], weight)
    decays = transient_columns(grid, fit.theta, fit.form)
    first = decays.shape[1]
    moved = moved + decays @ weights[:first] + edge_lines(weights[first:], taken.samples)[1:]
    rest = np.concatenate([[0.0], taken.position[1:] - moved])
    order = np.argsort(given.of_hz, kind="stable")
    spread = np.interp(taken.frequency_hz, given.of_hz[order], weight[order])
    return Residual(rest, spread, response, taken)


_BLOCK = 1 << 15
"""Lines whose slopes are worked out at once."""


def along_record(fit: SpectralFit, residuals: Sequence[Residual]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return how the position runs away from the model along the records, each with its 95 % half-width: by how many
    millionths its clock is slower than the command's, and by what part its gain rises from end to end.

    To first order, beside what the fit's own parameters would take of it.
    """
    products: FloatArray | None = None
    swing = power = 0.0
    for residual in residuals:
        taken = residual.taken
        lines = np.concatenate([[0.0], residual.response * taken.command[1:]])
        slope, moved = np.fft.irfft([2j * np.pi * taken.frequency_hz * lines, lines], taken.samples)
        place = np.arange(taken.samples) / taken.samples - 0.5
        # a gain that swings once along the record, in place of one that rises: the record's ends are given up
        turn = np.sin(2.0 * np.pi * place)
        beside = [place * taken.samples / taken.rate_hz * slope, turn * moved]
        swing += float(np.sum(turn**2 * moved**2))
        power += float(np.sum(turn * place * moved**2))
        runs = np.stack([*np.fft.rfft(beside), residual.lines], axis=1)
        for begin in range(1, lines.size, _BLOCK):
            block = slice(begin, begin + _BLOCK)
            free = log_slopes(fit, taken.frequency_hz[block]) * lines[block, None]
            columns = np.hstack([free, runs[block]]) * residual.weight[block, None]
            square = (columns.conj().T @ columns).real
            products = square if products is None else products + square
    assert products is not None
    size = np.sqrt(np.maximum(np.diag(products)[:-1], 1e-300))
    gram, goal = products[:-1, :-1] / np.outer(size, size), products[:-1, -1] / size
    inverse = np.linalg.pinv(gram, rcond=1e-10, hermitian=True)
    amounts, deviation = inverse @ goal / size, np.sqrt(np.maximum(0.5 * np.diag(inverse), 0.0)) / size
    to_unit = np.array([1e6, swing / max(power, 1e-300)])
    values, halves = to_unit * amounts[-2:], Z95 * to_unit * deviation[-2:]
    return (float(values[0]), float(halves[0])), (float(values[1]), float(halves[1]))


_SHORT, _LONG = 40, 200
"""Highest order of a whitening filter, samples; where a loop may be, the slow end of what disturbs matters too."""
_ENDS, _TAPER = 20, 0.1
"""Samples at either end of a record that a fit gave up, with those of a filter over them; share of the rest that a
window lets fade in and out."""
_TESTED = 1 << 17
"""Samples by which a residual is tested: more would see what no band is narrow enough for."""
_LENGTHS = (2, 5, 10, 20, 40)
"""Lengths of the filter that are tried, samples."""
_NUGGET = 1e-7
"""Share of white noise that keeps Levinson's recursion stable (-70 dB)."""


def joint_misfit(residual: Residual, highest_hz: float, *, filtered: bool) -> tuple[float, float]:
    """Return -2 log likelihood of position and command, constants aside, from the lines up to highest_hz of what a fit
    leaves, and how much of it a loop explains; filtered as for `explained_by_loop`.
    """
    inside = residual.taken.frequency_hz[1:] <= highest_hz
    power = mean_of_lines(np.abs(residual.lines[1:][inside]) ** 2)
    misfit = 2.0 * float(np.sum(np.log(np.maximum(power, 1e-12 * float(np.max(power, initial=1e-18))))))
    by_loop = explained_by_loop(residual, highest_hz, filtered=filtered)
    return misfit - by_loop, by_loop


def explained_by_loop(of_lines: Residual, highest_hz: float, *, filtered: bool) -> float:
    """Return by how much -2 log likelihood of the command's lines up to highest_hz falls if they follow the residual
    causally, Bayes' price of the filter paid; zero where no loop shows. filtered: behind filters, as it were a little
    before it.
    """
    taken = of_lines.taken
    count = int(np.searchsorted(taken.frequency_hz[1:], highest_hz, side="right"))
    command, residual = taken.command[1 : count + 1], of_lines.lines[1 : count + 1]
    before = mean_of_lines(np.abs(command) ** 2)
    usable = before > 0.0
    weight = np.where(usable, 1.0 / np.where(usable, before, 1.0), 0.0)
    products = np.zeros((2, taken.command.size), dtype=np.complex128)
    products[0, 1 : count + 1], products[1, 1 : count + 1] = (
        weight * np.abs(residual) ** 2,
        weight * np.conj(residual) * command,
    )
    autocovariance, shared = np.fft.irfft(products, taken.samples)
    autocovariance[0] *= 1.0 + _NUGGET
    price, lines = float(np.log(2.0 * usable.sum())), float(usable.sum())
    best, chosen = 0.0, None
    # samples by which the filters before the converters let a band-limited command seem to run ahead of the noise
    for early in (0, 3) if filtered else (0,):
        lags = (np.arange(-early, _LENGTHS[-1]) + taken.shift) % taken.samples
        # a residual of a few lines does not determine a longer filter
        for taps in _solutions(autocovariance[: lags.size], shared[lags]):
            if taps.size - early not in _LENGTHS:
                continue
            share = float(taps @ shared[lags[: taps.size]]) * taken.samples / (2.0 * lines)
            # a weight that is not yet the residual's own: less than all, and enough to separate the lengths
            won = -2.0 * lines * float(np.log(max(1.0 - share, 1e-9))) - price * taps.size
            if won > best:
                best, chosen = won, (lags[: taps.size], taps)
    if chosen is None:
        return 0.0
    lags, taps = chosen
    sparse = np.zeros(taken.samples)
    sparse[lags] = taps
    after = mean_of_lines(np.abs(command - np.fft.rfft(sparse)[1 : count + 1] * residual) ** 2)
    return max(best, 2.0 * float(np.sum(np.log(before[usable] / after[usable]))) - price * lags.size)


def _solutions(autocovariance: FloatArray, shared: FloatArray) -> Iterator[FloatArray]:
    """Yield the filters of 1, 2, .. taps that explain most of what is shared at the lags (n,) (Levinson, 1947)."""
    taps = np.zeros(0)
    for p, (filtered, error) in enumerate(prediction_filters(autocovariance)):
        missing = float(shared[p] - taps @ autocovariance[p:0:-1])
        taps = np.append(taps, 0.0) + missing / error * filtered[::-1]
        yield taps


def feedback_seen(residual: Residual, hold: Hold) -> bool | None:
    """Return true where the command follows the residual, None otherwise: the record cannot tell.

    A loop that is weak, or acts at the lowest frequencies alone, leaves no trace in a residual, so that no residual
    shows that there was none.
    """
    highest = HIGHEST * residual.taken.rate_hz
    # fall of -2 log likelihood of the command, all paid for, from which on a loop is taken to be there
    return explained_by_loop(residual, highest, filtered=hold == "band-limited") > 10.0 or None
