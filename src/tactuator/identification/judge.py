"""The frequency domain's estimate of a record as an identification: model, band, tests, and what speaks against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification import trust
from tactuator.identification.alignment import clock_skew_ppm
from tactuator.identification.check import (
    Prepared,
    check_length,
    check_polarity,
    check_rise,
    lasting,
    moved_range,
    valid_range,
)
from tactuator.identification.constancy import change_along
from tactuator.identification.distortion import Distortion
from tactuator.identification.fit import CERTAIN, REMAINS, SpectralEstimate
from tactuator.identification.fixed_values import beside_free, exact
from tactuator.identification.friction import VARIANCE_TIMES, FrictionFit, ruled_by_friction
from tactuator.identification.likelihood import SpectralFit
from tactuator.identification.nonlinear import distortion_left
from tactuator.identification.residual import (
    Residual,
    along_record,
    check_record_residual,
    feedback_seen,
    fit_percent,
    residuals_of_model,
)
from tactuator.identification.residual_tests import CHANCE, ResidualTests
from tactuator.identification.result import BetweenSamples, Candidate, Friction, Identification
from tactuator.identification.search import Choice
from tactuator.identification.uncertainty import (
    FLOOR,
    fed_back,
    left_over,
    log_slopes,
    other_forms,
    physical,
    response_of_rows,
)
from tactuator.model.plant_model import DB, Z95, PlantModel, QualityCheck

_TABLE = 120
"""Frequencies of the table of what goes beyond the covariance: 25 a decade of the usual five."""
_SHAPE_SHARE = 0.1
"""Share of the distortion by which a best linear approximation departs from any form of few poles: its shape follows
the level of every frequency. Seen on hardening springs and on friction; more would be found by the residual."""
_VAGUE = 0.5
"""Half-width of a friction over its level, from which on what it leaves may pass for a hold's half sample: 0.8 and 0.9
where it did, of 200 drawn records."""
_DEGREES = 14.0
"""Time scales by which a residual is tested."""
_RUN_AWAY, _FREE_OF_COMMAND = 20.0, 0.01
"""Nepers by which a growing pole grows in a record, and the chance of a residual free of the command, beyond which a
loop has to have held the plant."""
_BY_REFERENCE = "of the command what follows the recorded reference was fitted, free of noise fed back"
_UNRESOLVED = 5.0
"""Half-width of a Coulomb level c that builds up between two samples, in c²/(rms of the command): on records of another
generator it was off by up to 4 of these, and by less than the interval where friction's reversals can be seen."""


@np.errstate(all="ignore")
def identification(
    common: Prepared,
    estimate: SpectralEstimate,
    source: str,
    distortion: Distortion | None = None,
    friction_fit: FrictionFit | None = None,
    *,
    fitted: bool = True,
) -> Identification:
    """Return the identification by the chosen fit, its band wide enough for the other hold where none is certain;
    source: who says what the command does between its samples. distortion: what a periodic record shows beside the
    response. friction_fit: the fit of friction that it comes from. fitted: is the records' likelihood greatest there?
    """
    chosen, other = estimate.chosen, None
    residuals = estimate.residuals or residuals_of_model(chosen.fit, estimate.spectra, 0.5 * common.rate_hz)
    tests = _tests(estimate, residuals, distortion, fitted=fitted)
    friction, friction_fit = (None, None) if friction_fit is None else _friction(friction_fit, tests, common)
    model = _model(common, estimate, chosen, distortion, friction_fit)
    bent = distortion_left(residuals, model.excess.frequency_hz)
    if bent[0] > 0.0 or (friction is not None and friction.confidence > _VAGUE * friction.coulomb):
        estimate = _hold_beside_bending(estimate)
    between = BetweenSamples(chosen.hold, source, source != "data" or estimate.certain, estimate.advantage)
    rows = [*check_length(chosen.fit.poles_rad_s, _slow_pole_error(chosen), common.longest_s)]
    if source == "data":
        rows.append(trust.HOLD.of(estimate.advantage / estimate.enough, f"taken as {between.hold}"))
    if estimate.other is not None and not between.certain:
        other = _model(common, estimate, estimate.other, distortion, friction_fit)
        model = model.holding(other)
    model = _with_what_is_left(model.with_checks(*rows), tests, bent, common)
    model = replace(model, valid_hz=_valid(model, estimate), friction={} if friction is None else friction.stated)
    simulated, measured, percent = _positions(residuals, common)
    remarks = (*common.remarks, *_skew(chosen, model.confidence()["delay_s"]))
    result = Identification(
        model=model,
        order=chosen.fit.form.poles,
        excitation=replace(common.excitation, needed=chosen.fit.form.count),
        tests=tests,
        fit_percent=percent,
        friction=friction,
        tried=_tried(estimate),
        empirical=common.own_response,
        simulated=simulated,
        measured=measured,
        remarks=remarks if estimate.before is None else (*remarks, _BY_REFERENCE),
        between=between,
        other=other,
        distortion=distortion,
    )
    return result if estimate.free is None else _beside_free(result, common, estimate, estimate.free)


def _hold_beside_bending(estimate: SpectralEstimate) -> SpectralEstimate:
    """Return the estimate with the certainty of its hold where no form here has what bends the response: one hold's
    half sample may pass for that.
    """
    enough = VARIANCE_TIMES * estimate.enough
    return estimate if estimate.advantage >= enough else replace(estimate, certain=False, enough=enough)


def _positions(residuals: Sequence[Residual], common: Prepared) -> tuple[FloatArray, FloatArray, float]:
    """Return simulated and measured positions in the records' unit, (n,) each, and how well they fit, percent."""
    simulated = np.concatenate([residual.simulated for residual in residuals])
    measured = np.concatenate([residual.taken.measured for residual in residuals])
    offset, to_position = float(common.records[0].position.mean()), common.scale[1]
    percent = fit_percent(measured, simulated)
    return simulated * to_position + offset, measured * to_position + offset, percent


def _beside_free(
    result: Identification, common: Prepared, estimate: SpectralEstimate, free: SpectralEstimate
) -> Identification:
    alone = _model(common, free, free.chosen)
    alone = replace(alone, valid_hz=_valid(alone, free))
    beside = [choice for choice in (free.chosen, free.other) if choice is not None]
    both: Identification = beside_free(result, alone, common.options.gain_and_poles, estimate.chosen, beside)
    return replace(both, model=replace(both.model, valid_hz=_valid(both.model, estimate)))


def _with_what_is_left(
    model: PlantModel, tests: ResidualTests, bent: tuple[float, ComplexArray], common: Prepared
) -> PlantModel:
    """Return the model judged by its residuals and its constancy, its band with the distortion and the change that they
    show.
    """
    share, level = bent
    place = "" if tests.jump is None else common.place(tests.part, tests.jump)
    jump = trust.KNOCK.of(tests.knock, place, remedy="cut there: `from_s`, `to_s`")
    rise, half = tests.drift  # a gain alone is known better than the whole response of a part
    rising = (abs(rise) + half) / 3.0 if abs(rise) > 1.5 * half else 0.0
    along = tests.change.at(model.excess.frequency_hz)
    along = np.maximum(along.real, rising) + 1j * along.imag
    checked = model.with_checks(jump, trust.DISTORTION.of(100.0 * share))
    return replace(checked, excess=model.excess.joined(level).joined(along))


def _beyond_chance(tests: ResidualTests, common: Prepared) -> float:
    """Return the power of the residual that follows the command over what chance leaves of it, 1 where it may be that:
    the variance of what was estimated beside it grows alike (McCullagh and Nelder, Generalized Linear Models, 1989).
    """
    count = sum(command.size for command, _ in common.signals)
    return 1.0 if tests.uncorrelated_with_input else max(1.0, tests.unexplained * count / _DEGREES)


def _friction(friction_fit: FrictionFit, tests: ResidualTests, common: Prepared) -> tuple[Friction, FrictionFit]:
    """Return friction in the record's units, and its fit with a band that knows of the level no more than the level's
    own interval does.
    """
    beyond_chance = _beyond_chance(tests, common)
    friction = friction_of(friction_fit, beyond_chance, common)
    return friction, friction_fit.within(friction.confidence / common.scale[0], beyond_chance)


def friction_of(friction_fit: FrictionFit, beyond_chance: float, common: Prepared) -> Friction:
    """Return friction in the record's units, with the interval and the distance that the record allows.

    Where friction builds up between two samples only that it is short can be seen.
    """
    to_unit, to_position = common.scale
    half_width = Z95 * friction_fit.deviation * float(np.sqrt(beyond_chance))
    distance: float | None = friction_fit.presliding * to_position
    if friction_fit.presliding <= float(np.median(np.abs(np.diff(common.signals[0][1])))):
        half_width, distance = float(np.hypot(half_width, _UNRESOLVED * friction_fit.coulomb**2)), None
    return Friction(friction_fit.coulomb * to_unit, half_width * to_unit, distance)


def _tried(estimate: SpectralEstimate) -> tuple[Candidate, ...]:
    candidates = []
    for choice in (estimate.chosen, *([] if estimate.other is None else [estimate.other])):
        best = choice.problem.criterion(choice.fit)
        for form, fit in sorted(choice.fits.items(), key=lambda pair: choice.problem.criterion(pair[1])):
            behind = choice.problem.criterion(fit) - best
            candidates.append(Candidate(form.poles, form.zeros, form.dead_time, fit.cost, choice.hold, behind))
    return tuple(candidates)


def _model(
    common: Prepared,
    estimate: SpectralEstimate,
    choice: Choice,
    distortion: Distortion | None = None,
    friction_fit: FrictionFit | None = None,
) -> PlantModel:
    fit = choice.fit
    covariance = choice.problem.covariance_of(fit)
    if friction_fit is not None:
        covariance = covariance * (VARIANCE_TIMES * friction_fit.beyond_chance)
        if choice is estimate.chosen:
            covariance += friction_fit.shifts.T @ friction_fit.shifts
    fixed = [value for value in common.options.fixed if value.binds(fit.form)]
    table = np.geomspace(1.0 / common.longest_s, 0.5 * common.rate_hz, _TABLE)
    beyond = other_forms(choice, table)
    if choice.rival is not None:
        away = np.log(choice.rival.response(table) / fit.response(table))
        beyond = beyond.joined((np.abs(away.real) + 1j * np.abs(away.imag)) / Z95)
    skew_s = max(-fit.delay_s, 0.0)
    record: dict[str, str | float] = {"hold": choice.hold}
    if skew_s:
        record |= {"skew_s": skew_s}
        if _may_be_prompt(choice):
            beyond = beyond.joined(2j * np.pi * table * skew_s / Z95)
    bias = fed_back(choice, estimate.spectra) if choice.problem.with_transient else None
    if estimate.before is not None and choice is estimate.chosen:
        beyond = beyond.joined(REMAINS * np.log(estimate.before.response(table) / fit.response(table)))
    elif bias is not None:
        beyond = beyond.joined(log_slopes(fit, table) @ bias)
    if friction_fit is not None and choice is not estimate.chosen:
        for away in friction_fit.shifts @ log_slopes(estimate.chosen.fit, table).T:
            beyond = beyond.joined(away)
    if distortion is not None:
        bent = _SHAPE_SHARE * distortion.distortion / np.abs(distortion.value)
        beyond = beyond.joined(np.interp(np.log(table), np.log(distortion.frequency_hz), bent) * (1.0 + 1.0j))
    missing = left_over(fit, estimate.local, response_of_rows(fit, estimate.local.frequency_hz), table)
    model = common.model(
        *physical(fit, covariance, common.gain),
        delay_s=max(fit.delay_s, 0.0),
        method="refined",
        record=record | ({"fixed": " ".join(map(str, fixed))} if fixed else {}),
        excess=beyond.joined((np.hypot(missing, FLOOR)) * (1.0 + 1.0j)),
    )
    return exact(model, fixed)


def _may_be_prompt(choice: Choice) -> bool:
    """Return whether a form without a dead time below zero may explain the records as well."""
    least = choice.problem.criterion(choice.fit) + CERTAIN
    return any(fit.delay >= 0.0 and choice.problem.criterion(fit) < least for fit in choice.fits.values())


def _skew(choice: Choice, half_s: float) -> tuple[str, ...]:
    """Return what is to be said of a dead time below zero, half_s: its 95 % half-width."""
    late_s = -choice.fit.delay_s
    if not late_s > 0.0:
        return ()
    said = f"the position was read {1e3 * late_s:.3g} ± {1e3 * half_s:.2g} ms later than the command (channel skew)"
    if _may_be_prompt(choice):
        return (f"unknown whether {said} or the mechanism leads by as much; the band covers both",)
    return (f"likely {said}; the model is without it, and a dead time of the mechanism would add to it",)


def _valid(model: PlantModel, estimate: SpectralEstimate) -> tuple[float, float]:
    """Return from where to where the record moved the mechanism and the band is narrow."""
    lines = estimate.local.frequency_hz
    own_lines = not estimate.chosen.problem.with_transient
    return valid_range(model, (float(lines[0]), float(lines[-1])) if own_lines else moved_range(estimate.spectra))


def _tests(
    estimate: SpectralEstimate, residuals: Sequence[Residual], distortion: Distortion | None, *, fitted: bool
) -> ResidualTests:
    """Return the tests of all residuals; a loop counts as seen where it shows under either hold, or where the command
    of a periodic record does not repeat itself.
    """
    fit, pairs = estimate.chosen.fit, zip(estimate.data.signals, residuals, strict=True)
    tests = [
        check_record_residual(command, residual, fit, fitted=fitted, in_loop=estimate.data.in_loop)
        for (command, _), residual in pairs
    ]
    seen = {test.feedback for test in tests}
    if estimate.other is not None and estimate.other_residuals and not estimate.certain:
        hold = estimate.other.hold
        seen = seen if seen == {feedback_seen(residual, hold) for residual in estimate.other_residuals} else {None}
    part = max(range(len(tests)), key=lambda k: tests[k].knock)
    skew_ppm, drift = along_record(fit, residuals)
    # in a loop the command follows what disturbs, otherwise in every part
    signals = () if estimate.data.in_loop else estimate.data.signals
    lasting_s = max(part.samples / part.rate_hz for part in estimate.spectra)
    uncorrelated_p = min(1.0, len(tests) * min(test.uncorrelated_p for test in tests))
    # outside a loop a plant with such poles would have run away long before the record's end
    is_held = estimate.data.in_loop and fit.growth * lasting_s > _RUN_AWAY and uncorrelated_p > _FREE_OF_COMMAND
    # growing poles, and no loop in the response that it was fitted to: what follows the command is a distortion
    is_seen = True in seen and (estimate.data.in_loop or not fit.growth > 0.0)
    feedback: bool | None = is_seen or is_held or None
    if distortion is not None and distortion.repeats is not None:
        feedback = not distortion.repeats
    return ResidualTests(
        white_p=min(1.0, len(tests) * min(test.white_p for test in tests)),
        uncorrelated_p=uncorrelated_p,
        unexplained=max(test.unexplained for test in tests),
        feedback=feedback,
        knock=tests[part].knock,
        jump=tests[part].jump,
        part=part,
        skew_ppm=skew_ppm,
        drift=drift,
        change=change_along(fit, signals, [residual.taken for residual in residuals][: len(signals)]),
    )


def _slow_pole_error(choice: Choice) -> float:
    """Return the standard error of the slowest pole's real part, rad/s, to first order."""
    fit = choice.fit
    covariance = choice.problem.covariance_of(fit)
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


_ONE_CLOCK = "record both columns with one clock"
_SHORTER = "use a shorter part: `from_s`, `to_s`"
_STATE_LOOP = "with `closed_loop` yes if a position loop was closed around it"
_NO_LOOP = "record the motor outside its position loop, with noise several times as large as the friction"
_SHOWN = 20.0
"""Radians that a resonance turns in a record; one that turns less may be two integrators."""


def judge(result: Identification, common: Prepared) -> Identification:
    """Return the identification with all that decides whether its model is to be designed with."""
    if common.in_loop is not None:
        result = replace(result, tests=replace(result.tests, feedback=common.in_loop, stated=True))
    record = common.records[0]
    model = replace(result.model, record=result.model.record | {"feedback": result.tests.feedback_is})
    poles = np.roots(model.den)
    size = float(np.abs(poles).max())
    growing = float(np.sum(poles.real > 1e-6 * size))
    known = np.array([-value.fixed.rate for value in result.fixed if value.fixed.name == "pole"])
    unknown = [pole for pole in poles if not np.any(np.abs(known - pole) < 1e-6 * size)]
    fastest = float(np.max(np.abs(unknown), initial=0.0)) / (2.0 * np.pi)
    slowest = 1.0 / common.longest_s
    ringing = sum(abs(pole.real) < slowest and pole.imag > _SHOWN * slowest for pole in unknown)
    rest = 1.0 - result.fit_percent / 100.0
    seen_loop = result.tests.feedback is True
    follows = result.tests.uncorrelated_p < CHANCE
    ranges = _ranges(model, common)
    rows = [
        *ranges,
        *(() if any(row.refuses for row in ranges) else check_polarity(model.num, model.den)),
        # a loop that is known works against what disturbs: of what it leaves no command explains much
        *([] if common.in_loop else [trust.EXPLAINED.of(100.0 * (1.0 - rest**2), remedy=_STATE_LOOP * seen_loop)]),
        trust.GROWING.of(0.0 if result.tests.feedback is True else growing, remedy=_STATE_LOOP),
        trust.LASTING.of(float(ringing)),
        trust.FASTEST.of(fastest / (0.5 * record.rate_hz)),
        trust.FOLLOWING.of(100.0 * result.tests.unexplained * min(rest**2, 1.0) if follows else 0.0),
        _change(result.tests, common),
    ]
    friction = result.friction
    if friction is not None and friction.presliding is None:
        rows.append(trust.FRICTION.of(100.0 * friction.confidence / friction.coulomb))
        if not result.tests.uncorrelated_with_input:
            rows.append(trust.RUBBING.of(rest * float(np.std(record.command)) / friction.coulomb))
    model = model.with_checks(*rows)
    skew = max(abs(result.tests.skew_ppm[0]) - result.tests.skew_ppm[1], 0.0)
    if model.distrust or skew > trust.SKEW.limit:  # a residual shows only small ones
        skew = max(skew, *map(clock_skew_ppm, common.records))
    model = model.with_checks(trust.SKEW.of(skew, remedy=_ONE_CLOCK))
    if model.distrust:  # where a model cannot be trusted anyway, the likely slip helps
        model = model.with_checks(
            *(doubt.quality_check() for doubt in check_rise(common.response)),
            trust.RULED.of(100.0 * max(map(ruled_by_friction, common.records)), remedy=_NO_LOOP),
        )
    return replace(result, model=model)


def _change(tests: ResidualTests, common: Prepared) -> QualityCheck:
    """Return the check of the response's change along the records, or of the gain's, which is known better."""
    where = "" if tests.change.place is None else f"most {common.place(*tests.change.place)}"
    rise, half = tests.drift
    return trust.CHANGE.of(DB * max(tests.change.greatest, abs(rise) - half), where, remedy=_SHORTER)


def _ranges(model: PlantModel, common: Prepared) -> list[QualityCheck]:
    """Return what decides on the valid range: its part of what was excited, and the band inside it."""
    if model.valid_hz is None:
        return []
    low, high = (float(edge) for edge in model.valid_hz)
    excited = common.excitation.low_hz, common.excitation.high_hz
    inside = max(np.log(min(high, excited[1]) / max(low, excited[0])), 0.0)
    frequency = np.geomspace(low, high, 100)
    return [
        trust.VALID.of(
            100.0 * float(inside / max(np.log(excited[1] / excited[0]), 1e-9)), remedy=lasting(common.records)
        ),
        trust.BAND_DB.of(float(np.max(model.band_db(frequency)))),
        trust.BAND_DEG.of(float(np.degrees(np.max(model.band_rad(frequency))))),
    ]
