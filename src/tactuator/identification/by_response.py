"""A model from a frequency response by itself: what a data sheet or another instrument gives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.identification.asked import Asked, solvable
from tactuator.identification.form import Known, is_stable
from tactuator.identification.likelihood import SpectralFit, information
from tactuator.identification.lines import LocalResponse
from tactuator.identification.search import TIE, Choice, choose, propose
from tactuator.identification.spectral_estimate import CERTAIN
from tactuator.identification.standing import FixedAgainstOwn, beside_free, exact
from tactuator.identification.starts import Starter
from tactuator.identification.trust import GROWING, RESPONSE_ALIKE, RESPONSE_LEFT, RESPONSE_OFF, UNLIKELY
from tactuator.identification.uncertainty import left_over, log_slopes, moved, physical
from tactuator.model.plant_model import Excess, PlantModel
from tactuator.model.plausibility import response_doubts
from tactuator.processors import single_threaded
from tactuator.signals.record import FrequencyResponse

_STEPS, _FEW_STEPS = 40, 10


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A model of a response with its standing. order: poles; departure: mean squared departure in standard errors (1:
    as the confidence would have it); largest_db: at any point; remarks: what was done to the response; fixed: values
    that were fixed, beside the response's own.
    """

    model: PlantModel
    order: int
    departure: float
    largest_db: float
    remarks: tuple[str, ...]
    fixed: tuple[FixedAgainstOwn, ...] = ()

    @property
    def distrust(self) -> tuple[str, ...]:
        """Return why the model is not to be trusted, empty if it is."""
        return self.model.distrust


@np.errstate(all="ignore")
def identify_response(
    given: FrequencyResponse, asked: Asked, note: Callable[[str], None] = lambda _: None
) -> ResponseFit:
    """Return the model of a frequency response. Raises BadInput where no form fits at all."""
    asked = asked.of(given.about)
    with single_threaded(scipys=False), solvable():
        fits = _beginning(given, asked, note)
        astray, is_clear = _astray(given, fits)
        if not is_clear:
            whole = _identify_response(_with_own_noise(given, fits), asked, note)
        if not astray.any():
            return whole
        note("leaving out points that stand off all others")
        kept = _at(given, ~astray)
        without = _identify_response(_with_own_noise(kept, _beginning(kept, asked, note)), asked, note)
        without = _reaching(without, given, kept, "far off what all others follow, left out")
        if is_clear:
            return without
        whole = replace(whole, model=whole.model.holding(without.model))
        return _reaching(
            whole, given, kept, "bad readings or poles (more points near them will tell), the band holds both"
        )


def _at(given: FrequencyResponse, kept: NDArray[np.bool_]) -> FrequencyResponse:
    """Return the response at the points that are kept, (m,)."""
    names = ("frequency_hz", "magnitude", "deviation", *(() if given.phase_rad is None else ("phase_rad",)))
    return replace(given, **{name: getattr(given, name)[kept] for name in names})


def _off(fit: SpectralFit | PlantModel, given: FrequencyResponse) -> ComplexArray:
    """Return the logarithm of the fit's response over the given one, (m,); of magnitudes alone it is real."""
    if given.phase_rad is None:
        return np.log(np.abs(fit.response(given.frequency_hz)) / given.magnitude) + 0j
    return np.asarray(np.log(fit.response(given.frequency_hz) / given.value()))


def _beginning(given: FrequencyResponse, asked: Asked, note: Callable[[str], None]) -> list[SpectralFit]:
    """Return fits of all forms, best first, that leave half the equations to tell the noise by."""
    local, rate_hz, scale = _prepared(given)
    known = asked.known(1.0).without_values
    fits = propose(local, rate_hz, scale, ("band-limited",), known, note)["band-limited"]
    fits = [fit for fit in fits if fit.form.count < given.magnitude.size]
    return fits if given.phase_rad is not None else [fit_magnitude(fit, given, _FEW_STEPS) for fit in fits]


_OUT, _MOST_OUT = 40.0, 0.1
"""Square of a departure over their median from which on a point may be a bad reading; share of points that may be."""
_IN_A_ROW = 4
"""Neighbours off from which on they are no bad readings, but what the form lacks."""
_ROUNDS = 6
_CLEAR = 30.0
"""What leaving points out has to win of Bayes' criterion; within it the form of fewest poles says which: a resonance
may stand at any point, and bend to its neighbours' noise."""


def _astray(given: FrequencyResponse, fits: Sequence[SpectralFit]) -> tuple[NDArray[np.bool_], bool]:
    """Return which points stand off the form that all others follow, (m,), and whether that is clear: other poles may
    explain them as well.

    A bad point costs two parameters, its own magnitude and phase, at the price of any other: where poles and zeros
    explain it, it stays.
    """
    points, parts = given.magnitude.size, 1 if given.phase_rad is None else 2
    price = float(np.log(parts * points))

    def criterion(cost: float, fit: SpectralFit, out: int) -> float:
        return parts * points * float(np.log(max(cost, 1e-300))) + price * (fit.form.count + parts * out)

    trials = [(fit, *_trimmed(given, fit, int(_MOST_OUT * points))) for fit in fits]
    scores = [criterion(cost, fit, int(out.sum())) for fit, cost, out in trials]
    usual = [fit for fit in fits if is_stable(fit.theta, fit.form)]
    whole, poles = min(((criterion(fit.cost, fit, 0), fit.form.poles) for fit in usual), default=(np.inf, 0))
    near = [k for k, score in enumerate(scores) if score < min(min(scores), whole) + _CLEAR and trials[k][2].any()]
    best = min(near, key=lambda k: (fits[k].form.poles, scores[k]), default=None)
    if best is None or (scores[best] > whole - _CLEAR and fits[best].form.poles >= poles):
        return np.zeros(points, dtype=np.bool_), False
    return trials[best][2], scores[best] < whole - _CLEAR


def _trimmed(given: FrequencyResponse, fit: SpectralFit, most: int) -> tuple[float, NDArray[np.bool_]]:
    """Return the cost of the fit of that form after it was freed of the points that stand off it, and which they are,
    (m,), `most` of them.

    At first every point counts the less, the farther it stands off (Cauchy's weights), later not at all. Bad points
    draw poles to them, also into the right half plane: they are mirrored.
    """
    local, rate_hz, scale = _prepared(given)
    problem = replace(Starter(local, rate_hz, "band-limited", scale).problem, stable=True)
    cost, out = fit.cost, np.zeros(problem.weight.size, dtype=np.bool_)
    for k in range(2 * _ROUNDS):
        off = np.abs(_off(fit, given) / given.deviation) ** 2
        usual = max(float(np.median(off)), 1e-300)
        before, out = out, off > max(_OUT * usual, float(np.sort(off)[-1 - most]))
        if (k == 0 and not out.any()) or (k >= _ROUNDS and np.array_equal(out, before)):
            break
        share = np.where(out, 1e-9, 1.0) if k >= _ROUNDS else 1.0 / np.sqrt(1.0 + off / usual / 4)
        if given.phase_rad is None:
            again: SpectralFit | None = fit_magnitude(
                fit, replace(given, deviation=given.deviation / share), _FEW_STEPS
            )
        else:
            weighted = replace(problem, weight=share * problem.weight)
            again = weighted.descend(fit.form, np.abs(fit.theta), fit.delay, most=_FEW_STEPS)
        if again is None:
            break
        fit, cost = again, again.cost
    is_lacking = np.convolve(out, np.ones(_IN_A_ROW)).max() >= _IN_A_ROW or not is_stable(fit.theta, fit.form)
    return (np.inf, np.zeros_like(out)) if is_lacking else (cost, out)


def _reaching(result: ResponseFit, given: FrequencyResponse, kept: FrequencyResponse, said: str) -> ResponseFit:
    """Return the fit with its band reaching the points that were not kept, and these named: each may be a narrow
    resonance.
    """
    out = ~np.isin(given.frequency_hz, kept.frequency_hz)
    hertz, model = given.frequency_hz[out], result.model
    off = _off(model, given)[out] / 1.959964
    frequency = np.sort(np.concatenate([model.excess.frequency_hz, hertz]))
    place, magnitude, phase_rad = np.searchsorted(frequency, hertz), *model.excess.at(frequency)
    magnitude[place] = np.maximum(magnitude[place], np.abs(off.real))
    phase_rad[place] = np.maximum(phase_rad[place], np.abs(off.imag))
    said = f"{said}: at {', '.join(f'{at:.5g}' for at in hertz)} Hz"
    model = replace(model, excess=Excess(frequency, magnitude, phase_rad))
    return replace(result, model=model, remarks=(*result.remarks, said))


def _with_own_noise(given: FrequencyResponse, fits: Sequence[SpectralFit]) -> FrequencyResponse:
    """Return the response with the deviation that it shows itself, where that is more than what was assumed: by what
    the form leaves that is best by Bayes' criterion for noise of an unknown level.
    """
    parts = 1.0 if given.phase_rad is None else 2.0
    equations = parts * given.magnitude.size
    if not fits or not given.assumed:
        return given
    price = float(np.log(equations))
    best = min(fits, key=lambda fit: equations * np.log(max(fit.cost, 1e-300)) + price * fit.form.count)
    off = _off(best, given) / given.deviation
    # an instrument's magnitudes may be far worse than its phases, or the other way round: the worse of them counts
    worse = max(float(np.sum(off.real**2)), float(np.sum(off.imag**2)))
    more = float(np.sqrt(parts * worse / (equations - best.form.count)))
    if more <= 1.0:
        return given
    said = f"by what a model leaves of it the error is {100.0 * more * float(np.median(given.deviation)):.2g} %"
    return replace(given, deviation=more * given.deviation, remarks=(*given.remarks, said))


def _prepared(given: FrequencyResponse) -> tuple[LocalResponse, float, float]:
    """Return the points with the power of their errors, a rate that says how long a dead time may be, and the scale of
    time.
    """
    value = given.value()
    # the error of a phase is as large as that of the magnitude, and adds as much power
    power = 2.0 * given.deviation**2 if given.phase_rad is not None else _unsure(given) ** 2
    variance, ones = power * given.magnitude**2, np.ones(value.size)
    local = LocalResponse(given.frequency_hz, value, variance, variance, ones, ones)
    return local, 4.0 * float(given.frequency_hz[-1]), 2.0 * np.pi * float(np.exp(np.mean(np.log(given.frequency_hz))))


def _identify_response(given: FrequencyResponse, asked: Asked, note: Callable[[str], None]) -> ResponseFit:
    value, by_magnitude = given.value(), given.phase_rad is None
    local, rate_hz, scale = _prepared(given)
    delay_s = 0.0 if given.phase_rad is None and asked.delay_s is None else asked.delay_s
    if by_magnitude and asked.fixed:
        raise BadInput("fixed values with a magnitude without phase", "with a response of both, or a record")
    known = replace(asked, delay_s=delay_s).known(1.0)
    problem = Starter(local, rate_hz, "band-limited", scale).problem

    def best_of(wanted: Known, near: Sequence[SpectralFit] = ()) -> Choice:
        fits = propose(local, rate_hz, scale, ("band-limited",), wanted, note, near={"band-limited": near})
        if not fits["band-limited"]:
            raise BadInput("no model of the form asked for fits the response", "another order, or more zeros")
        # forms beside the best one are tried from it: a pole and a zero that all but cancel go together
        best = choose(problem.given, fits["band-limited"], "band-limited", wanted, weight=problem.weight)
        if is_stable(best.fit.theta, best.fit.form):
            return best
        mirrored = [replace(fit, theta=np.abs(fit.theta)) for fit in (best.fit, *fits["band-limited"])]
        stable = choose(problem.given, mirrored, "band-limited", wanted, weight=problem.weight, stable=True)
        return stable if stable.criterion(stable.fit) < best.criterion(best.fit) + CERTAIN else best

    free = best_of(known.without_values)
    if by_magnitude:
        allowed = [fit_magnitude(candidate, given) for candidate in free.fits.values() if known.allows(candidate.form)]
        fit = _settled(allowed, value.size)
        return _judged(given, fit, magnitude_covariance(fit, given), local, asked)
    free_fit = _judged(given, free.fit, information(free.problem, free.fit), local, asked)
    if not asked.fixed:
        return free_fit
    bound = best_of(known, tuple(free.fits.values()))
    bound_fit = _judged(given, bound.fit, information(bound.problem, bound.fit), local, asked)
    both: ResponseFit = beside_free(bound_fit, free_fit.model, asked.fixed, bound, [free])
    return both


def _unsure(given: FrequencyResponse) -> FloatArray:
    """Return the relative error of a response of computed phase: what lies beyond its ends turns it most there."""
    place = np.log(given.frequency_hz)
    to_end = np.minimum(place - place[0], place[-1] - place)
    return np.asarray(np.hypot(given.deviation, 0.02 + 0.13 * np.exp(-2.0 * to_end)))


def _settled(fits: list[SpectralFit], equations: int) -> SpectralFit:
    """Return the form of best criterion (Bayes); of those within a tie the one of fewer poles."""
    price = float(np.log(equations))
    scores = [2.0 * fit.cost + price * fit.form.count for fit in fits]
    rows = [(fit.form.poles, score, k) for k, (fit, score) in enumerate(zip(fits, scores, strict=True))]
    return fits[min(row for row in rows if row[1] < min(scores) + TIE)[2]]


def fit_magnitude(fit: SpectralFit, given: FrequencyResponse, steps: int = _STEPS) -> SpectralFit:
    """Return the fit after Gauss and Newton's descent on the logarithm of the magnitudes alone."""
    goal, fit = np.log(given.magnitude), replace(fit, theta=np.abs(fit.theta))  # no mirrored pole changes a magnitude

    def misfit(trial: SpectralFit) -> FloatArray:
        return np.asarray((goal - np.log(np.abs(trial.response(given.frequency_hz)))) / given.deviation)

    now = misfit(fit)
    for _ in range(steps):
        slopes = log_slopes(fit, given.frequency_hz).real / given.deviation[:, None]
        size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
        if not np.all(np.isfinite(slopes)):
            break
        step = np.linalg.lstsq(slopes / size, now, rcond=1e-9)[0] / size
        trials = [moved(fit, share * step) for share in (1.0, 0.3, 0.1, 0.03)]
        trials = [trial for trial in trials if is_stable(trial.theta, trial.form)] or [fit]
        sums = [float(np.sum(misfit(trial) ** 2)) for trial in trials]
        best = int(np.nanargmin([value if np.isfinite(value) else np.inf for value in sums]))
        if not sums[best] < float(now @ now) - 1e-6:
            break
        fit, now = trials[best], misfit(trials[best])
    return replace(fit, cost=0.5 * float(now @ now))


def magnitude_covariance(fit: SpectralFit, given: FrequencyResponse) -> FloatArray:
    """Return the covariance of (numerator, theta, dead time) by the magnitudes alone."""
    slopes = log_slopes(fit, given.frequency_hz).real / given.deviation[:, None]
    size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    gram = (slopes / size).T @ (slopes / size)
    return np.asarray(np.linalg.pinv(gram, rcond=1e-13, hermitian=True) / np.outer(size, size))


def _judged(
    given: FrequencyResponse, fit: SpectralFit, covariance: FloatArray, local: LocalResponse, asked: Asked
) -> ResponseFit:
    response = fit.response(given.frequency_hz)
    off_db = 20.0 * np.log10(np.abs(response) / given.magnitude)
    departure = float(np.mean((off_db / (8.686 * given.deviation)) ** 2))
    num, den, spread = physical(fit, covariance * max(1.0, departure), 1.0)
    missing = left_over(fit, local, response, given.frequency_hz)
    low, high = float(given.frequency_hz[0]), float(given.frequency_hz[-1])
    model = PlantModel(
        num=num,
        den=den,
        delay_s=fit.delay_s,
        covariance=spread,
        band_hz=(low, high),
        quantity=asked.quantity,
        method="response",
        record=dict(given.about),
        excess=Excess(given.frequency_hz, missing, missing),
        valid_hz=(low, high),
    )
    if fit.form.pins or fit.form.known:
        model = exact(replace(model, record=model.record | {"fixed": " ".join(map(str, asked.fixed))}), asked.fixed)
    off = _off(model, given)
    alike = float(np.real(np.sum(off[1:] * np.conj(off[:-1]))) / max(float(np.sum(np.abs(off) ** 2)), 1e-300))
    doubts = response_doubts(given)
    is_coarse = given.assumed and departure > 0.5
    largest = float(np.max(np.abs(off_db)))
    model = model.judged(
        GROWING.of(float(np.sum(np.roots(den).real > 0.0))),
        RESPONSE_OFF.of(departure, f"by up to {largest:.3g} dB"),
        RESPONSE_ALIKE.of(alike if is_coarse else 0.0),
        RESPONSE_LEFT.of(100.0 * float(np.sqrt(np.mean(np.abs(off) ** 2))) if given.assumed else 0.0),
        UNLIKELY.of(float(len(doubts)), "; ".join(doubts)),
    )
    return ResponseFit(model, fit.form.poles, departure, largest, given.remarks)
