"""The frequency domain's estimate of a record as an identification: model, band, tests, and what speaks against it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.by_prediction import Prepared, usual_band
from tactuator.identification.estimate.loops import dahl_state
from tactuator.identification.estimate.refined import Samples
from tactuator.identification.evidence.checks import check_length, check_polarity
from tactuator.identification.evidence.curvature import cubic_share
from tactuator.identification.evidence.distortion import Distortion
from tactuator.identification.evidence.feedback import feedback_seen
from tactuator.identification.evidence.residuals import ResidualTests, check_residual, jump_of
from tactuator.identification.evidence.whitening import apply_filter, whitening_filter
from tactuator.identification.fixed.standing import FixedAgainstOwn, cancelled, disagrees, exact, said_of_disagreement
from tactuator.identification.forms.known import Known
from tactuator.identification.forms.pins import freedom
from tactuator.identification.result import BetweenSamples, Identification
from tactuator.identification.selection import Candidate
from tactuator.identification.spectral.hold import Hold
from tactuator.identification.spectral.hold_choice import SpectralEstimate, estimate
from tactuator.identification.spectral.instrument import REMAINS, choice_by_reference
from tactuator.identification.spectral.likelihood import SpectralFit, information
from tactuator.identification.spectral.lines import Spectrum
from tactuator.identification.spectral.record_residual import Residual, record_residual
from tactuator.identification.spectral.search import Choice
from tactuator.identification.spectral.uncertainty import (
    fed_back,
    left_over,
    log_slopes,
    other_forms,
    physical,
    response_of_rows,
)
from tactuator.identification.valid_range import moved_range, valid_range
from tactuator.model.plant_model import Excess, PlantModel

_TABLE = 120
_FLOOR = 5e-4
"""Deviation that no band goes below, 0.0085 dB at 95 %: two channels' converters and filters are not more alike."""
_BENT = 0.1
"""Share of the distortion by which a best linear approximation departs from any form of few poles: its shape follows
the level of every frequency. Seen on hardening springs and on friction; more would be found by the residual."""
_TESTED = 1 << 17
"""Samples by which a residual is tested: more would see what no band is narrow enough for."""
_WHY = " (command and position fall off below half the rate, as behind the filters of converters)"
_CERTAIN_FRICTION = 100.0
"""Drop of -2 log likelihood by one parameter from which on friction is looked for."""


def spectral_estimate(
    common: Prepared, holds: tuple[Hold, ...], known: Known, note: Callable[[str], None]
) -> SpectralEstimate:
    """Return the frequency domain's estimate of the prepared record."""
    signals = [(one.command, one.position) for one in common.all_samples]
    rate_hz = common.samples.rate_hz
    found = estimate(signals, rate_hz, holds, known, note)
    references = [one.reference for one in common.all_records if one.reference is not None]
    if found.chosen.hold != "band-limited" or len(references) != len(signals):
        return found
    note("fitting what follows the reference")
    chosen = choice_by_reference(found.chosen, found.spectra, references)
    if chosen is None:
        return found
    left = record_residual(chosen, found.spectra)
    return replace(found, chosen=chosen, residuals=left, before=found.chosen.fit)


def friction_shows(residuals: Sequence[Residual]) -> bool:
    """Return true where a friction along the model's own path explains more of the residual than chance ever would."""
    motion = max(float(np.std(left.simulated)) for left in residuals)
    for presliding in np.geomspace(1e-3, 1.0, 4) * motion:
        size = along = 0.0
        for left in residuals:
            state = dahl_state(np.ascontiguousarray(left.simulated), float(presliding))
            lines = np.fft.rfft(state - state.mean()) / np.sqrt(state.size)
            pull = left.response * lines[1:] * left.weight[1:]
            size += float(np.sum(np.abs(pull) ** 2))
            along += float(np.sum((np.conj(pull) * left.lines[1:] * left.weight[1:]).real))
        if size > 0.0 and along < 0.0 and 2.0 * along**2 / size > _CERTAIN_FRICTION:
            return True
    return False


@np.errstate(all="ignore")
def identification(
    common: Prepared,
    found: SpectralEstimate,
    residuals: Sequence[Residual],
    between: BetweenSamples,
    distortion: Distortion | None = None,
) -> Identification:
    """Return the identification by the chosen fit, its band wide enough for the other hold where none is certain;
    distortion: what a periodic record shows beside the response.
    """
    chosen, to_unit, to_position = found.chosen, *common.scale
    gain, other = to_position / to_unit, None
    model = _model(common, found, chosen, gain, distortion)
    remarks = list(common.remarks)
    if found.before is not None:
        remarks.append("of the command what follows the recorded reference was fitted, free of noise fed back")
    if found.other is not None and not found.certain and between.source == "data":
        other = _model(common, found, found.other, gain, distortion)
        model = model.holding(other)
        remarks.append(
            f"whether the command was held or band-limited between its samples cannot be told (difference "
            f"{found.advantage:.2g}): taken as {between.hold}{_WHY if found.flanks else ''}, the band holds both; "
            "--hold says which it is"
        )
    model = replace(model, valid_hz=_valid(model, found))
    tests = _tests(common, found, residuals)
    if distortion is not None and distortion.repeats is not None:
        tests = replace(tests, feedback=not distortion.repeats)
    remarks += _said_of(tests, common, chosen.hold == "band-limited" and found.before is None)
    remarks += _said_of_cube(cubic_share(found.spectra, residuals))
    remarks += check_length(chosen.fit.poles_rad_s, _slow_pole_error(chosen), common.longest_s)
    remarks += check_polarity(model.num, model.den)
    offset, (simulated, measured, percent) = float(common.record.position.mean()), _shown(residuals)
    made = Identification(
        model=model,
        order=chosen.fit.form.poles,
        excitation=replace(common.excitation, needed=chosen.fit.form.count),
        tests=tests,
        fit_percent=percent,
        friction=None,
        tried=_tried(found),
        empirical=common.own_response,
        simulated=simulated * to_position + offset,
        measured=measured * to_position + offset,
        remarks=tuple(remarks),
        between=between,
        other=other,
        distortion=distortion,
    )
    return made if found.free is None else _beside_free(made, common, found, found.free)


def _beside_free(
    made: Identification, common: Prepared, found: SpectralEstimate, free: SpectralEstimate
) -> Identification:
    """Return the identification with what the record shows without the values that are fixed; where it speaks against
    them, the band holds both.
    """
    alone = _model(common, free, free.chosen, common.scale[1] / common.scale[0])
    alone = replace(alone, valid_hz=_valid(alone, free))
    made = replace(made, fixed=tuple(FixedAgainstOwn(one, one.of_model(alone)) for one in common.fixed))
    beside = [one for one in (free.chosen, free.other) if one is not None]
    if not disagrees(found.chosen, beside) and not cancelled(made.fixed, made.model):
        return made
    said, is_wrong = said_of_disagreement(made.fixed, made.model, alone)
    model = made.model.holding(alone)
    made = replace(made, model=replace(model, valid_hz=_valid(model, found)))
    if is_wrong:
        return replace(made, distrust=(*made.distrust, said))
    return replace(made, remarks=(*made.remarks, said))


def _said_of(tests: ResidualTests, common: Prepared, filtered: bool) -> list[str]:
    """Return what is to be said of a residual; filtered: of a band-limited command, no reference at hand."""
    said = []
    if tests.feedback and filtered:
        said.append(
            "recorded in a loop, through filters: what its noise may have done is in the band; a recorded reference "
            "(--reference) takes it out"
        )
    if tests.jump is not None:
        said.append(
            f"at {tests.jump / common.record.rate_hz:.6g} s the position jumps as neither command nor noise explains: "
            "a knock, or two runs pasted together (--from-s and --to-s leave it out)"
        )
    return said


def _said_of_cube(share: float) -> list[str]:
    said = (
        f"{100.0 * share:.2g} % of the residual follows the cube of the command: something saturates or is not linear,"
    )
    return [f"{said} and the model is the best linear one at this amplitude"] if share > 0.0 else []


def _shown(residuals: Sequence[Residual]) -> tuple[FloatArray, FloatArray, float]:
    """Return the simulated and the measured positions of all records and the fit, percent."""
    simulated = np.concatenate([left.simulated for left in residuals])
    measured = np.concatenate([left.measured for left in residuals])
    spread = float(np.linalg.norm(measured))
    share = float(np.linalg.norm(simulated - measured)) / spread if spread > 0.0 else 1.0
    return simulated, measured, 100.0 * (1.0 - share)


def with_doubt(made: Identification, found: SpectralEstimate, between: BetweenSamples) -> Identification:
    """Return the identification with a band that holds the other hold too, where the record cannot tell them apart, and
    with the frequencies at which the record moved the mechanism.
    """
    made = replace(made, model=replace(made.model, valid_hz=_valid(made.model, found)))
    if between.certain or found.other is None:
        return replace(made, between=replace(between, hold="zero-order"))
    table = np.geomspace(1.0 / made.model.band_hz[1], 0.5 * found.spectra[0].rate_hz, _TABLE)
    apart = np.log(found.other.fit.response(table) / found.chosen.fit.response(table))
    excess = Excess(table, np.zeros(table.size), np.zeros(table.size)).joined(apart / 1.96)
    said = "whether the command was held or band-limited cannot be told: taken as held, the band holds both"
    return replace(
        made,
        model=replace(made.model, excess=excess),
        between=replace(between, hold="zero-order"),
        remarks=(*made.remarks, said),
    )


def _tried(found: SpectralEstimate) -> tuple[Candidate, ...]:
    made = []
    for choice in (found.chosen, *([] if found.other is None else [found.other])):
        best = choice.criterion(choice.fit)
        for form, fit in sorted(choice.fits.items(), key=lambda one: choice.criterion(one[1])):
            behind = choice.criterion(fit) - best
            made.append(Candidate(form.poles, form.zeros, form.dead_time, fit.cost, float("nan"), choice.hold, behind))
    return tuple(made)


def _model(
    common: Prepared, found: SpectralEstimate, choice: Choice, gain: float, distortion: Distortion | None = None
) -> PlantModel:
    fit, record = choice.fit, common.record
    covariance = information(choice.problem, fit)
    num, den, spread = physical(fit, covariance, gain)
    high = 0.5 * record.rate_hz
    asked = {"fixed": " ".join(map(str, common.fixed))} if fit.form.pins or fit.form.known else {}
    table = np.geomspace(1.0 / common.longest_s, high, _TABLE)
    beyond = other_forms(choice, table)
    bias = fed_back(choice, found.spectra) if choice.problem.with_transient else None
    if found.before is not None and choice is found.chosen:
        beyond = beyond.joined(REMAINS * np.log(found.before.response(table) / fit.response(table)))
    elif bias is not None:
        beyond = beyond.joined(log_slopes(fit, table) @ bias)
    if distortion is not None:
        bent = _BENT * distortion.distortion / np.abs(distortion.value)
        beyond = beyond.joined(np.interp(np.log(table), np.log(distortion.frequency_hz), bent) * (1.0 + 1.0j))
    local = found.local
    missing = left_over(fit, local, response_of_rows(fit, local.frequency_hz), table)
    beyond = beyond.joined((np.hypot(missing, _FLOOR)) * (1.0 + 1.0j))
    model = PlantModel(
        num=num,
        den=den,
        delay_s=fit.delay_s,
        covariance=spread,
        band_hz=usual_band(record),
        quantity=common.quantity,
        command_unit=record.command_unit,
        position_unit=record.position_unit,
        method="spectral",
        record=record.about | {"rate_hz": record.rate_hz, "duration_s": record.duration_s, "hold": choice.hold} | asked,
        excess=beyond,
    )
    return exact(model, common.fixed) if fit.form.pins else model


def _valid(model: PlantModel, found: SpectralEstimate) -> tuple[float, float]:
    """Return from where to where the record moved the mechanism and the band is narrow."""
    lines = found.local.frequency_hz
    own_lines = not found.chosen.problem.with_transient
    return valid_range(model, (float(lines[0]), float(lines[-1])) if own_lines else moved_range(found.spectra))


def _tests(common: Prepared, found: SpectralEstimate, residuals: Sequence[Residual]) -> ResidualTests:
    rows = zip(common.all_samples, residuals, found.spectra, strict=True)
    made = [residual_tests(samples, left, found.chosen.fit, taken) for samples, left, taken in rows]
    seen = {one.feedback for one in made}
    if found.other_residuals and not found.certain and seen != _feedback_of_other(found):
        seen = {None}
    return ResidualTests(
        white_p=min(1.0, len(made) * min(one.white_p for one in made)),
        uncorrelated_p=min(1.0, len(made) * min(one.uncorrelated_p for one in made)),
        unexplained=max(one.unexplained for one in made),
        feedback=True in seen or None,
        jump=next((one.jump for one in made if one.jump is not None), None),
    )


def _feedback_of_other(found: SpectralEstimate) -> set[bool | None]:
    """Return what is seen of a loop under the other hold, by record."""
    return {feedback_seen(*pair) for pair in zip(found.spectra, found.other_residuals, strict=True)}


def residual_tests(
    samples: Samples, left: Residual, fit: SpectralFit, taken: Spectrum, *, fitted: bool = True
) -> ResidualTests:
    """Return the tests of what the fit leaves of one record; fitted: the record took part in the fit."""
    residual = left.measured - left.simulated
    whitener = whitening_filter(residual)
    command = samples.command[: residual.size]
    skip = whitener.size + 1
    innovation = apply_filter(whitener, residual)[skip:]
    tested = slice(skip, skip + _TESTED)
    moved = apply_filter(whitener, command)[tested]
    slopes = np.zeros((moved.size, 0))
    if fitted:
        # around the record's ends the filter turns in a circle, no farther than what is left out before the tests
        white = np.fft.rfft(whitener, taken.samples)[1:] * left.response * taken.command[1:]
        free = freedom(fit.theta, fit.form, fit.rungs)
        lines = np.zeros((free.shape[1], taken.command.size), dtype=np.complex128)
        lines[:, 1:] = ((log_slopes(fit, taken.frequency_hz[1:]) @ free) * white[:, None]).T
        slopes = np.fft.irfft(lines, taken.samples)[:, tested].T
    tests = check_residual(innovation[:_TESTED], moved, slopes, samples.rate_hz, loop=False)
    jump = jump_of(innovation)
    return replace(tests, feedback=feedback_seen(taken, left), jump=None if jump is None else jump + skip + taken.shift)


def _slow_pole_error(choice: Choice) -> float:
    """Return the standard error of the slowest pole's real part, rad/s, to first order."""
    fit = choice.fit
    covariance = information(choice.problem, fit)
    first = fit.numerator.size
    block = covariance[first : first + fit.theta.size, first : first + fit.theta.size]
    gradient = np.zeros(fit.theta.size)
    slow = _slowest(fit, fit.theta)
    for j in range(fit.theta.size):
        step = np.zeros(fit.theta.size)
        step[j] = 1e-6 * max(abs(float(fit.theta[j])), 1e-9)
        gradient[j] = (_slowest(fit, fit.theta + step) - slow) / step[j]
    return float(np.sqrt(max(float(gradient @ block @ gradient), 0.0))) * fit.grid.scale_rad_s


def _slowest(fit: SpectralFit, theta: FloatArray) -> float:
    poles = replace(fit, theta=theta).poles_rad_s / fit.grid.scale_rad_s
    return float(poles[np.argmin(np.abs(poles.real))].real) if poles.size else 0.0
