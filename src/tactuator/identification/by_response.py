"""A model from a frequency response by itself: what a data sheet or another instrument gives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray
from tactuator.errors import BadInput
from tactuator.identification import trust
from tactuator.identification.check import valid_range
from tactuator.identification.data import Data
from tactuator.identification.fit import SpectralEstimate, fit, propose_starts
from tactuator.identification.fitted import Fitted, trust_table
from tactuator.identification.fixed_values import FixedAgainstOwn, beside_free, exact
from tactuator.identification.form import Known, is_stable
from tactuator.identification.hold import Hold
from tactuator.identification.likelihood import SpectralFit, SpectralProblem
from tactuator.identification.lines import LocalResponse
from tactuator.identification.magnitudes import Magnitudes
from tactuator.identification.options import Fixed, IdentifyOptions, solvable
from tactuator.identification.search import Choice, propose
from tactuator.identification.uncertainty import left_over, other_forms, physical
from tactuator.model.plant_model import DB, Z95, Excess, PlantModel
from tactuator.model.plausibility import response_doubts
from tactuator.processors import single_threaded
from tactuator.result import Fact, ResultTable
from tactuator.signals.record import FrequencyResponse

_HOLD: tuple[Hold, ...] = ("band-limited",)
_FEW_STEPS = 10
"""Steps of a descent that only ranks forms."""


@dataclass(frozen=True, eq=False, repr=False)
class ResponseFit(Fitted):
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
    out: Path | None = None

    def tables(self) -> Sequence[ResultTable]:
        """Return the model with its confidence, and what it is trusted by."""
        title = f"response: {self.order} poles, {self.model.num.size - 1} zeros"
        return [ResultTable(title, ("what", "value"), tuple(_rows(self))), trust_table(self.model)]

    def facts(self) -> Sequence[Fact]:
        """Return the fit, the model and what it rests on."""
        largest = Fact("largest_db", self.largest_db, "departure", "dB", ".3g", True)
        return [*self.fitted(largest), Fact("departure", self.departure), Fact("out", self.out)]


def _rows(fit: ResponseFit) -> list[tuple[str, str]]:
    """Return what `identify` prints of a model of a frequency response: name and value."""
    rows = []
    for name, values in (("numerator", fit.model.num), ("denominator", fit.model.den)):
        top = values.size - 1
        rows += [(f"{name}, s^{top - k}", f"{value:.5g}") for k, value in enumerate(values)]
    rows += [
        (f"fixed: {known.fixed.name}", f"{str(known.fixed).partition('=')[2]} {known.beside}") for known in fit.fixed
    ]
    rows.append(("dead time (ms)", f"{1e3 * fit.model.delay_s:.3g}"))
    return [*rows, ("largest departure from the response (dB)", f"{fit.largest_db:.2f}")]


@np.errstate(all="ignore")
def identify_response(
    given: FrequencyResponse, options: IdentifyOptions, note: Callable[[str], None] = lambda _: None
) -> ResponseFit:
    """Return the model of a frequency response. Raises BadInput where no form fits at all."""
    options = options.of(given.about)
    if given.phase_rad is None:
        if options.gain_and_poles:
            raise BadInput("fixed values with a magnitude without phase", "with a response of both, or a record")
        options = replace(options, fixed=(Fixed("delay_s", options.delay_s or 0.0),))
    with single_threaded(scipys=False), solvable():
        fits = _beginning(given, options, note)
        astray, is_clear = _astray(given, fits)
        if not is_clear:
            whole = _identify_response(_with_own_noise(given, fits), options, note)
        if not astray.any():
            return _narrowed(whole, given)
        note("leaving out points that are off all others")
        kept = _at(given, ~astray)
        without = _identify_response(_with_own_noise(kept, _beginning(kept, options, note)), options, note)
        without = _reaching(_narrowed(without, kept), given, kept, "far off what all others follow, left out")
        if is_clear:
            return without
        whole = _narrowed(replace(whole, model=whole.model.holding(without.model)), given)
        return _reaching(
            whole, given, kept, "bad readings or poles (measure more points near them); the band covers both"
        )


def _narrowed(result: ResponseFit, given: FrequencyResponse) -> ResponseFit:
    """Return the fit, of magnitudes alone valid where its band of the magnitude is narrow."""
    if given.phase_rad is not None:
        return result
    (low, high), valid = result.model.band_hz, valid_range(result.model, result.model.band_hz, np.inf)
    share = 100.0 * float(np.log(valid[1] / valid[0]) / np.log(high / low))
    return replace(result, model=replace(result.model, valid_hz=valid).with_checks(trust.VALID.of(share)))


def _at(given: FrequencyResponse, kept: NDArray[np.bool_]) -> FrequencyResponse:
    """Return the response at the points that are kept, (m,)."""
    names = ("frequency_hz", "magnitude", "deviation", *(() if given.phase_rad is None else ("phase_rad",)))
    return replace(given, **{name: getattr(given, name)[kept] for name in names})


def _off(fit: SpectralFit | PlantModel, given: FrequencyResponse) -> ComplexArray:
    """Return the logarithm of the fit's response over the given one, (m,); of magnitudes alone it is real."""
    if given.phase_rad is None:
        return np.log(np.abs(fit.response(given.frequency_hz)) / given.magnitude) + 0j
    return np.asarray(np.log(fit.response(given.frequency_hz) / given.value()))


def _data(given: FrequencyResponse) -> Data:
    """Return the points with the power of their errors; the rate says how long a dead time may be."""
    value = given.value()
    # the error of a phase is as large as that of the magnitude, and adds as much power
    variance, ones = 2.0 * (given.deviation * given.magnitude) ** 2, np.ones(value.size)
    local, rate_hz = (
        LocalResponse(given.frequency_hz, value, variance, variance, ones, ones),
        4.0 * given.frequency_hz[-1],
    )
    if given.phase_rad is None:
        return Data(local, rate_hz, weight=1.0 / (given.deviation * given.magnitude), kind=Magnitudes)
    return Data(local, rate_hz, weight=local.weight)


def _known(given: FrequencyResponse, options: IdentifyOptions) -> Known:
    """Return what is known beforehand; for magnitudes alone, without a requested form."""
    known = options.known(1.0)
    return known if given.phase_rad is not None else replace(known, poles=None, zeros=None)


def _beginning(given: FrequencyResponse, options: IdentifyOptions, note: Callable[[str], None]) -> list[SpectralFit]:
    """Return fits of all forms, best first, that leave half the equations to estimate the noise."""
    data = _data(given)
    fits = propose(data, _HOLD, _known(given, options).without_values, note)["band-limited"]
    fits = [fit for fit in fits if fit.form.count < given.magnitude.size]
    problem = data.problem(data.scale_rad_s, "band-limited")
    return [problem.sized(fit, _FEW_STEPS) for fit in fits] if isinstance(problem, Magnitudes) else fits


_OUT, _MOST_OUT = 40.0, 0.1
"""Square of a departure over their median from which on a point may be a bad reading; share of points that may be."""
_IN_A_ROW = 4
"""Neighbours off from which on they are no bad readings, but what the form lacks."""
_ROUNDS = 6
"""Descents with doubtful points counting less, and as many without them: the set of points is stable by then."""
_CLEAR = 30.0
"""What leaving points out has to win of Bayes' criterion; within it the form of fewest poles says which: a resonance
may be at any point, and bend to its neighbours' noise."""


def _astray(given: FrequencyResponse, fits: Sequence[SpectralFit]) -> tuple[NDArray[np.bool_], bool]:
    """Return which points are off the form that all others follow, (m,), and whether that is clear: other poles may
    explain them as well.

    A bad point costs two parameters, its own magnitude and phase, at the price of any other: where poles and zeros
    explain it, it stays.
    """
    points, parts = given.magnitude.size, 1 if given.phase_rad is None else 2
    price = float(np.log(parts * points))

    def criterion(cost: float, fit: SpectralFit, out: int) -> float:
        return parts * points * float(np.log(max(cost, 1e-300))) + price * (fit.form.count + parts * out)

    data = _data(given)
    problem = data.problem(data.scale_rad_s, "band-limited", stable=True)
    trials = [(fit, *_trimmed(problem, given, fit, int(_MOST_OUT * points))) for fit in fits]
    scores = [criterion(cost, fit, int(out.sum())) for fit, cost, out in trials]
    usual = [fit for fit in fits if is_stable(fit.theta, fit.form)]
    whole, poles = min(((criterion(fit.cost, fit, 0), fit.form.poles) for fit in usual), default=(np.inf, 0))
    near = [k for k, score in enumerate(scores) if score < min(min(scores), whole) + _CLEAR and trials[k][2].any()]
    best = min(near, key=lambda k: (fits[k].form.poles, scores[k]), default=None)
    if best is None or (scores[best] > whole - _CLEAR and fits[best].form.poles >= poles):
        return np.zeros(points, dtype=np.bool_), False
    return trials[best][2], scores[best] < whole - _CLEAR


def _trimmed(
    problem: SpectralProblem, given: FrequencyResponse, fit: SpectralFit, most: int
) -> tuple[float, NDArray[np.bool_]]:
    """Return the cost of the fit of that form after it was freed of the points that are off it, and which they are,
    (m,), `most` of them.

    At first every point counts the less, the farther it is off (Cauchy's weights), later not at all. Bad points
    draw poles to them, also into the right half plane: they are mirrored.
    """
    cost, out = fit.cost, np.zeros(problem.weight.size, dtype=np.bool_)
    for k in range(2 * _ROUNDS):
        off = np.abs(_off(fit, given) / given.deviation) ** 2
        usual = max(float(np.median(off)), 1e-300)
        before, out = out, off > max(_OUT * usual, float(np.sort(off)[-1 - most]))
        if (k == 0 and not out.any()) or (k >= _ROUNDS and np.array_equal(out, before)):
            break
        share = np.where(out, 1e-9, 1.0) if k >= _ROUNDS else 1.0 / np.sqrt(1.0 + off / usual / 4)
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
    off = _off(model, given)[out] / Z95
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


def _identify_response(given: FrequencyResponse, options: IdentifyOptions, note: Callable[[str], None]) -> ResponseFit:
    data, asked = _data(given), options.known(1.0)

    def estimate_of(known: Known) -> SpectralEstimate:
        return fit(data, propose_starts(data, _HOLD, known.without_values, note), known, note)

    estimate = estimate_of(_known(given, options))
    found = _described(given, estimate.chosen, data.local, options)
    if estimate.free is not None:
        alone = _described(given, estimate.free.chosen, data.local, options).model
        fixed = options.gain_and_poles
        beside: ResponseFit = beside_free(found, alone, fixed, estimate.chosen, [estimate.free.chosen])
        return beside
    form, problem = estimate.chosen.fit.form, estimate.chosen.problem
    if asked.allows(form):
        return found
    # magnitudes that show another form than that asked for
    assert isinstance(problem, Magnitudes)
    zeros = form.zeros if asked.zeros is None else asked.zeros
    poles = asked.poles or max(form.poles, zeros)
    if poles >= form.poles and zeros >= form.zeros:
        more = problem.shown(estimate.chosen.fit, replace(form, poles=poles, zeros=zeros))[0]
        choice = replace(estimate.chosen, fit=more, fits={**estimate.chosen.fits, more.form: more})
        remark = f"by itself it shows {form.poles} poles and {form.zeros} zeros: more lie where nothing shows"
        padded = _described(given, choice, data.local, options)
        return replace(padded, remarks=(*padded.remarks, remark))
    bound = estimate_of(asked).chosen
    other: ResponseFit = beside_free(
        _described(given, bound, data.local, options), found.model, (), bound, [estimate.chosen]
    )
    return other


def _described(given: FrequencyResponse, choice: Choice, local: LocalResponse, options: IdentifyOptions) -> ResponseFit:
    fit, covariance = choice.fit, choice.problem.covariance_of(choice.fit)
    response = fit.response(given.frequency_hz)
    off_db = 20.0 * np.log10(np.abs(response) / given.magnitude)
    departure = float(np.mean((off_db / (DB * given.deviation)) ** 2))
    num, den, spread = physical(fit, covariance * max(1.0, departure), 1.0)
    missing = left_over(fit, local, response, given.frequency_hz)
    excess = Excess(given.frequency_hz, missing, missing)
    low, high = float(given.frequency_hz[0]), float(given.frequency_hz[-1])
    if given.phase_rad is None:
        variance, seen = (given.deviation * given.magnitude) ** 2, given.magnitude * response / np.abs(response)
        local = replace(local, value=seen, variance=variance, noise=variance)
        beyond = left_over(fit, local, response, given.frequency_hz)
        excess = other_forms(choice, given.frequency_hz).joined(beyond + 1j * missing)
    model = PlantModel(
        num=num,
        den=den,
        delay_s=fit.delay_s,
        covariance=spread,
        band_hz=(low, high),
        quantity=options.quantity,
        method="response",
        record=dict(given.about),
        excess=excess,
        valid_hz=(low, high),
    )
    fixed = [value for value in options.fixed if value.binds(fit.form)]
    if fixed and given.phase_rad is not None:
        model = exact(replace(model, record=model.record | {"fixed": " ".join(map(str, fixed))}), fixed)
    off = _off(model, given)
    alike = float(np.real(np.sum(off[1:] * np.conj(off[:-1]))) / max(float(np.sum(np.abs(off) ** 2)), 1e-300))
    doubts = response_doubts(given)
    is_coarse = given.assumed and departure > 0.5
    largest = float(np.max(np.abs(off_db)))
    model = model.with_checks(
        trust.GROWING.of(float(np.sum(np.roots(den).real > 0.0))),
        trust.RESPONSE_OFF.of(departure, f"by up to {largest:.3g} dB"),
        trust.RESPONSE_ALIKE.of(alike if is_coarse else 0.0),
        trust.RESPONSE_LEFT.of(100.0 * float(np.sqrt(np.mean(np.abs(off) ** 2))) if given.assumed else 0.0),
        trust.UNLIKELY.of(float(len(doubts)), "; ".join(doubts)),
    )
    return ResponseFit(model, fit.form.poles, departure, largest, given.remarks)
