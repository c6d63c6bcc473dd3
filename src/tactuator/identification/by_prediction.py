"""The time domain's estimates: by prediction error, for held commands and friction, and the paper's recursion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.identification.estimate.friction import Friction, seen_presliding
from tactuator.identification.estimate.recursive import identify_recursively
from tactuator.identification.estimate.refined import RefinedEstimate, Samples
from tactuator.identification.estimate.states import companion_states
from tactuator.identification.estimate.structure import RationalModel, Structure
from tactuator.identification.evidence.checks import check_length, check_polarity
from tactuator.identification.evidence.empirical import EmpiricalResponse
from tactuator.identification.evidence.excitation import ExcitationReport, require_excitation
from tactuator.identification.evidence.residuals import check_residual
from tactuator.identification.fixed.value import Fixed
from tactuator.identification.result import Identification
from tactuator.identification.selection import Candidate
from tactuator.identification.valid_range import valid_range_of
from tactuator.model.plant import DERIVATIVES
from tactuator.model.plant_model import Excess, PlantModel
from tactuator.signals.record import Record

_BENT = 4.0
"""Variance beside friction, over what the residual's part that follows the command would have it: what friction leaves
is at each frequency alike in sign, and was up to 1.5 half-widths on records of another generator."""
_UNRESOLVED = 5.0
"""Half-width of a Coulomb level c that builds up between two samples, in c²/(rms of the command): on records of another
generator it was off by up to 4 of these, and by less than the interval where friction's reversals can be seen."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """A record, its samples of unit size (scale: of command and position), their own response, and what is asked.

    others: further records of the same mechanism, with their samples in the same scale. fixed: values that are known.
    """

    record: Record
    samples: Samples
    scale: tuple[float, float]
    response: EmpiricalResponse
    excitation: ExcitationReport
    quantity: str
    order: int | None
    remarks: tuple[str, ...]
    others: tuple[tuple[Record, Samples], ...] = ()
    fixed: tuple[Fixed, ...] = ()

    @property
    def all_samples(self) -> tuple[Samples, ...]:
        """Return the samples of every record, those of `record` first."""
        return (self.samples, *(samples for _, samples in self.others))

    @property
    def all_records(self) -> tuple[Record, ...]:
        """Return every record, `record` first."""
        return (self.record, *(record for record, _ in self.others))

    @property
    def own_response(self) -> EmpiricalResponse:
        """Return the record's own response in the record's units."""
        return replace(self.response, value=self.response.value * (self.scale[1] / self.scale[0]))

    @property
    def longest_s(self) -> float:
        """Return the duration of the longest record."""
        return max(one.duration_s for one in self.all_records)


def refined(common: Prepared, estimate: RefinedEstimate, tried: tuple[Candidate, ...]) -> Identification:
    """Return the identification of a finished refined estimate."""
    fit = estimate.fit
    to_unit, to_position = common.scale
    friction = _told(common, estimate)
    excitation = replace(common.excitation, needed=fit.structure.count, condition=estimate.condition)
    require_excitation(excitation)
    covariance, transform = inflated(estimate), _to_polynomials(fit.structure, fit.model, to_position / to_unit)
    remarks = list(common.remarks)
    poles = np.roots(fit.model.denominator())
    remarks += check_length(poles, _slow_pole_error(fit.model, fit.structure, covariance), common.record.duration_s)
    remarks += check_polarity(fit.model.numerator(), fit.model.denominator())
    if not estimate.tests.uncorrelated_with_input:
        remarks.append(
            f"{100.0 * estimate.tests.unexplained:.2g} % of the residual still follows the command (not linear, or of "
            f"a higher order): the band is widened accordingly"
        )
    if np.any(poles.real > 1e-9 * np.abs(poles).max()):
        remarks.append("the model is not stable")
    model = PlantModel(
        num=fit.model.numerator() * to_position / to_unit,
        den=fit.model.denominator(),
        delay_s=fit.model.delay_s,
        covariance=transform @ covariance @ transform.T,
        band_hz=usual_band(common.record),
        quantity=common.quantity,
        command_unit=common.record.command_unit,
        position_unit=common.record.position_unit,
        method="refined",
        record=common.record.about | {"rate_hz": common.record.rate_hz, "duration_s": common.record.duration_s},
        friction=_stated(friction),
    )
    return Identification(
        model=replace(model, valid_hz=valid_range_of(model, common.samples)),
        order=fit.structure.poles,
        excitation=excitation,
        tests=estimate.tests,
        fit_percent=estimate.fit_percent,
        friction=friction,
        tried=tried,
        empirical=common.own_response,
        simulated=estimate.simulated * to_position + float(common.record.position.mean()),
        measured=common.record.position[-estimate.simulated.size :],
        remarks=tuple(remarks),
    )


def _told(common: Prepared, estimate: RefinedEstimate) -> Friction | None:
    """Return the friction in the record's units, with the interval and the distance that the record allows to tell."""
    found = estimate.friction
    if found is None or found.presliding is None:
        return found
    to_unit, to_position = common.scale
    half_width = float(np.sqrt(_inflation(estimate))) * found.confidence
    distance = seen_presliding(found.presliding, common.samples.position)
    if distance is None:
        half_width = float(np.hypot(half_width, _UNRESOLVED * found.coulomb**2))
        return Friction(found.coulomb * to_unit, half_width * to_unit, None)
    return Friction(found.coulomb * to_unit, half_width * to_unit, distance * to_position)


def _stated(friction: Friction | None) -> dict[str, float]:
    """Return what a model file says of friction; a presliding distance that nobody can tell is left out."""
    if friction is None:
        return {}
    known = {} if friction.presliding is None else {"presliding": friction.presliding}
    return {"coulomb": friction.coulomb, **known}


def inflated(estimate: RefinedEstimate) -> FloatArray:
    """Return the covariance, times how much more of the residual follows the command than chance would have it (at
    least 1): what the structure cannot say is uncertainty as well.
    """
    return estimate.covariance * _inflation(estimate)


def _inflation(estimate: RefinedEstimate) -> float:
    if estimate.tests.uncorrelated_with_input:
        return 1.0
    count = estimate.fit.minimum.prediction.residual.size
    more = max(1.0, estimate.tests.unexplained * count / 14.0)
    return more if estimate.friction is None else _BENT * more


def usual_band(record: Record) -> tuple[float, float]:
    """Return 0.4 .. 300 Hz as far as the record reaches; all that it reaches where that is less than a decade."""
    lowest, highest = 1.0 / record.duration_s, 0.45 * record.rate_hz
    low, high = max(0.4, lowest), min(300.0, highest)
    return (low, high) if high >= 10.0 * low else (lowest, highest)


def _to_polynomials(structure: Structure, model: RationalModel, gain: float) -> FloatArray:
    """Return the matrix from theta to (num descending, den[1:] descending, delay_s)."""
    n, m, w = structure.poles, structure.zeros, model.scale_rad_s
    made = np.zeros((m + n + 2, structure.count))
    for column, i in enumerate(range(structure.integrated, m + 1)):
        made[m - i, column] = gain * w ** float(n - i)
    for j in range(n):
        made[m + 1 + (n - 1 - j), structure.numerator_count + j] = w ** float(n - j)
    if structure.dead_time:
        made[-1, -1] = 1.0 / w
    return made


def _slow_pole_error(model: RationalModel, structure: Structure, covariance: FloatArray) -> float:
    """Return the standard error of the slowest pole's real part, rad/s, to first order."""
    polynomial = np.append(1.0, model.a[::-1])
    poles = np.roots(polynomial)
    slow = poles[np.argmin(np.abs(poles.real))]
    slope = np.polyval(np.polyder(polynomial), slow)
    if slope == 0.0:
        return float("inf")
    first = structure.numerator_count
    gradient = np.array([-(slow**j) / slope for j in range(structure.poles)])
    block = covariance[first : first + structure.poles, first : first + structure.poles]
    return float(np.sqrt(max(np.real(gradient.real @ block @ gradient.real), 0.0)) * model.scale_rad_s)


def recursive(common: Prepared, forgetting: float) -> Identification:
    """Return the paper's estimate, judged by the same tests."""
    samples = common.samples
    order = common.order or 2
    integrated = DERIVATIVES[common.quantity]
    if integrated >= order:
        raise BadInput(f"order {order} for a {common.quantity} by least squares", f"{integrated + 1} or more")
    estimate = identify_recursively(
        samples.command, samples.position, samples.rate_hz, poles=order, zeros=integrated, forgetting=forgetting
    )
    excitation = replace(common.excitation, needed=order + 1)
    require_excitation(excitation)
    gain = common.scale[1] / common.scale[0]
    simulated = simulate(estimate.num, estimate.den, samples)
    residual = samples.position - simulated - np.mean(samples.position - simulated)
    tests = check_residual(residual, samples.command, samples.command[:, None], samples.rate_hz)
    remarks = list(common.remarks) + list(check_length(np.roots(estimate.den), 0.0, common.record.duration_s))
    remarks.append("least squares is biased by sensor noise: its confidence covers the noise, not the bias")
    sizes = np.append(np.full(integrated + 1, gain), np.ones(order))
    covariance = np.zeros((sizes.size + 1, sizes.size + 1))
    covariance[:-1, :-1] = estimate.covariance * np.outer(sizes, sizes)
    if not tests.uncorrelated_with_input:
        remarks.append("the residual follows the command: the band holds the record's own response as well")
    spread = float(np.linalg.norm(samples.position - samples.position.mean()))
    model = PlantModel(
        num=estimate.num * gain,
        den=estimate.den,
        delay_s=0.0,
        covariance=covariance,
        band_hz=usual_band(common.record),
        quantity=common.quantity,
        command_unit=common.record.command_unit,
        position_unit=common.record.position_unit,
        method="rls",
        record=common.record.about | {"rate_hz": common.record.rate_hz, "duration_s": common.record.duration_s},
        excess=Excess.none() if tests.uncorrelated_with_input else _departure(common, estimate.num, estimate.den),
    )
    return Identification(
        model=replace(model, valid_hz=valid_range_of(model, samples)),
        order=order,
        excitation=excitation,
        tests=tests,
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(residual)) / spread),
        friction=None,
        tried=(),
        empirical=common.own_response,
        simulated=(simulated - simulated.mean()) * common.scale[1] + float(common.record.position.mean()),
        measured=common.record.position,
        remarks=tuple(remarks),
    )


def _departure(common: Prepared, num: FloatArray, den: FloatArray) -> Excess:
    """Return how far the record's own response, with its error, is from the model, as a standard deviation: friction
    bends that response as well, to the same side.
    """
    own = common.response
    s = 2j * np.pi * own.frequency_hz
    apart = np.log(own.value * np.polyval(den, s) / np.polyval(num, s))
    size = np.abs(apart.real) + 1j * np.abs(apart.imag)
    none = Excess(own.frequency_hz, np.zeros(s.size), np.zeros(s.size))
    return none.joined(size).joined(own.relative_error * (1.0 + 1.0j))


def simulate(num: FloatArray, den: FloatArray, samples: Samples) -> FloatArray:
    """Return the position by num/den (fewer zeros than poles) from rest, (n,)."""
    states = companion_states(den, samples.command, samples.rate_hz, hold=samples.hold)
    return np.asarray(states[:, : num.size] @ num[::-1])
