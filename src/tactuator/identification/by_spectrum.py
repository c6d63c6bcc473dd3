"""The frequency domain's estimate of a record as an identification: model, band, tests, and what speaks against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.distortion import Distortion
from tactuator.identification.form import freedom
from tactuator.identification.friction import BENT, FrictionFit
from tactuator.identification.likelihood import SpectralFit, information
from tactuator.identification.lines import Spectrum
from tactuator.identification.prepared import (
    Prepared,
    Samples,
    check_length,
    check_polarity,
    moved_range,
    usual_band,
    valid_range,
)
from tactuator.identification.residual import Residual, cubic_share, feedback_seen
from tactuator.identification.residual_tests import (
    ResidualTests,
    apply_filter,
    check_residual,
    jump_of,
    whitening_filter,
)
from tactuator.identification.result import BetweenSamples, Candidate, Friction, Identification
from tactuator.identification.search import Choice
from tactuator.identification.spectral_estimate import REMAINS, SpectralEstimate
from tactuator.identification.standing import FixedAgainstOwn, cancelled, disagrees, exact, said_of_disagreement
from tactuator.identification.uncertainty import (
    fed_back,
    left_over,
    log_slopes,
    other_forms,
    physical,
    response_of_rows,
)
from tactuator.model.plant_model import PlantModel

_TABLE = 120
_FLOOR = 5e-4
"""Deviation that no band goes below, 0.0085 dB at 95 %: two channels' converters and filters are not more alike."""
_BENT = 0.1
"""Share of the distortion by which a best linear approximation departs from any form of few poles: its shape follows
the level of every frequency. Seen on hardening springs and on friction; more would be found by the residual."""
_TESTED = 1 << 17
"""Samples by which a residual is tested: more would see what no band is narrow enough for."""
_WHY = " (command and position fall off below half the rate, as behind the filters of converters)"
_DEGREES = 14.0
"""Time scales by which a residual is tested."""
_UNRESOLVED = 5.0
"""Half-width of a Coulomb level c that builds up between two samples, in c²/(rms of the command): on records of another
generator it was off by up to 4 of these, and by less than the interval where friction's reversals can be seen."""


@np.errstate(all="ignore")
def identification(
    common: Prepared,
    found: SpectralEstimate,
    source: str,
    residuals: Sequence[Residual],
    distortion: Distortion | None = None,
    rubbed: FrictionFit | None = None,
) -> Identification:
    """Return the identification by the chosen fit, its band wide enough for the other hold where none is certain;
    source: who says what the command does between its samples. distortion: what a periodic record shows beside the
    response. rubbed: the fit of friction that it comes from.
    """
    between = BetweenSamples(found.chosen.hold, source, source != "data" or found.certain, found.advantage)
    if rubbed is not None:
        common = common.with_commands(rubbed.commands)
    chosen, gain, other = found.chosen, common.gain, None
    to_position = common.scale[1]
    model = _model(common, found, chosen, gain, distortion, rubbed)
    remarks = list(common.remarks)
    if found.before is not None:
        remarks.append("of the command what follows the recorded reference was fitted, free of noise fed back")
    if found.other is not None and not found.certain and between.source == "data":
        other = _model(common, found, found.other, gain, distortion, rubbed)
        model = model.holding(other)
        remarks.append(
            f"whether the command was held or band-limited between its samples cannot be told (difference "
            f"{found.advantage:.2g}): taken as {between.hold}{_WHY if found.flanks else ''}, the band holds both; "
            "--hold says which it is"
        )
    tests = _tests(common, found, residuals)
    friction = None if rubbed is None else friction_of(rubbed, tests, common)
    model = replace(model, valid_hz=_valid(model, found), friction={} if friction is None else friction.stated)
    if distortion is not None and distortion.repeats is not None:
        tests = replace(tests, feedback=not distortion.repeats)
    remarks += _said_of(tests, common, chosen.hold == "band-limited" and found.before is None)
    remarks += _said_of_cube(cubic_share(found.spectra, residuals))
    remarks += check_length(chosen.fit.poles_rad_s, _slow_pole_error(chosen), common.longest_s)
    remarks += check_polarity(model.num, model.den)
    offset, (simulated, measured, percent) = float(common.records[0].position.mean()), _shown(residuals)
    made = Identification(
        model=model,
        order=chosen.fit.form.poles,
        excitation=replace(common.excitation, needed=chosen.fit.form.count),
        tests=tests,
        fit_percent=percent,
        friction=friction,
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
    alone = _model(common, free, free.chosen, common.gain)
    alone = replace(alone, valid_hz=_valid(alone, free))
    made = replace(made, fixed=tuple(FixedAgainstOwn(one, one.of_model(alone)) for one in common.asked.fixed))
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
            f"at {tests.jump / common.rate_hz:.6g} s the position jumps as neither command nor noise explains: "
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


def friction_of(rubbed: FrictionFit, tests: ResidualTests, common: Prepared) -> Friction:
    """Return friction in the record's units, with the interval and the distance that the record allows to tell.

    Where friction builds up between two samples only that it is short can be seen.
    """
    to_unit, to_position = common.scale
    count = sum(one.command.size for one in common.samples)
    more = 1.0 if tests.uncorrelated_with_input else max(1.0, tests.unexplained * count / _DEGREES)
    half_width = 1.959964 * rubbed.deviation * float(np.sqrt(more))
    distance: float | None = rubbed.presliding * to_position
    if rubbed.presliding <= float(np.median(np.abs(np.diff(common.samples[0].position)))):
        half_width, distance = float(np.hypot(half_width, _UNRESOLVED * rubbed.coulomb**2)), None
    return Friction(rubbed.coulomb * to_unit, half_width * to_unit, distance)


def _tried(found: SpectralEstimate) -> tuple[Candidate, ...]:
    made = []
    for choice in (found.chosen, *([] if found.other is None else [found.other])):
        best = choice.criterion(choice.fit)
        for form, fit in sorted(choice.fits.items(), key=lambda one: choice.criterion(one[1])):
            behind = choice.criterion(fit) - best
            made.append(Candidate(form.poles, form.zeros, form.dead_time, fit.cost, float("nan"), choice.hold, behind))
    return tuple(made)


def _model(
    common: Prepared,
    found: SpectralEstimate,
    choice: Choice,
    gain: float,
    distortion: Distortion | None = None,
    rubbed: FrictionFit | None = None,
) -> PlantModel:
    fit, record = choice.fit, common.records[0]
    covariance = information(choice.problem, fit) * (1.0 if rubbed is None else BENT)
    num, den, spread = physical(fit, covariance, gain)
    high = 0.5 * record.rate_hz
    asked = {"fixed": " ".join(map(str, common.asked.fixed))} if fit.form.pins or fit.form.known else {}
    table = np.geomspace(1.0 / common.longest_s, high, _TABLE)
    beyond = other_forms(choice, table)
    bias = fed_back(choice, found.spectra) if choice.problem.with_transient else None
    if found.before is not None and choice is found.chosen:
        beyond = beyond.joined(REMAINS * np.log(found.before.response(table) / fit.response(table)))
    elif bias is not None:
        beyond = beyond.joined(log_slopes(fit, table) @ bias)
    if rubbed is not None:
        beyond = beyond.joined(log_slopes(found.chosen.fit, table) @ rubbed.shift)
        apart = np.log(rubbed.other.response(table) / found.chosen.fit.response(table))
        beyond = beyond.joined(apart)
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
        quantity=common.asked.quantity,
        command_unit=record.command_unit,
        position_unit=record.position_unit,
        method="spectral",
        record=common.source(hold=choice.hold, **asked),
        excess=beyond,
    )
    return exact(model, common.asked.fixed) if fit.form.pins else model


def _valid(model: PlantModel, found: SpectralEstimate) -> tuple[float, float]:
    """Return from where to where the record moved the mechanism and the band is narrow."""
    lines = found.local.frequency_hz
    own_lines = not found.chosen.problem.with_transient
    return valid_range(model, (float(lines[0]), float(lines[-1])) if own_lines else moved_range(found.spectra))


def _tests(common: Prepared, found: SpectralEstimate, residuals: Sequence[Residual]) -> ResidualTests:
    rows = zip(common.samples, residuals, found.spectra, strict=True)
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
