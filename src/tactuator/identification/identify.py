"""From a record to a model with its uncertainty: all of identification behind one function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactuator.display.load import DERIVATIVES
from tactuator.errors import BadInput
from tactuator.identification import by_spectrum
from tactuator.identification.asked import Asked
from tactuator.identification.by_inverse_dynamics import motor_identification
from tactuator.identification.by_prediction import Prepared, recursive, refined
from tactuator.identification.estimate.refined import Samples, judge
from tactuator.identification.evidence.checks import check_direction, check_record
from tactuator.identification.evidence.empirical import empirical_response
from tactuator.identification.evidence.excitation import excitation_report, require_excitation
from tactuator.identification.result import BetweenSamples, Identification
from tactuator.identification.selection import choose_structure
from tactuator.identification.spectral.between import HOLDS, Between
from tactuator.identification.trust import distrusted
from tactuator.signals.record import Record

Array = NDArray[np.float64]
LONGEST = 1_000_000
"""Samples identified at once; of a longer record the part with most command power is taken."""
METHODS = ("refined", "prediction", "rls")


def identify(
    record: Record,
    *,
    method: str = "refined",
    forgetting: float = 1.0,
    note: Callable[[str], None] = lambda _: None,
    **wishes: object,
) -> Identification:
    """Return a continuous model of a record.

    wishes: the fields of `Asked`. method: "refined" (maximum likelihood in the frequency domain, and by prediction
    error where friction shows), "prediction" (prediction error alone, for held commands), "rls" (the paper's recursive
    least squares, with `forgetting`). Raises BadInput for a record that cannot tell this.
    """
    if method not in METHODS:
        raise BadInput(f"method {method!r}; allowed: {', '.join(METHODS)}")
    asked = Asked(**wishes)  # type: ignore[arg-type]
    common = _prepared(record, asked)
    if method == "rls":
        return recursive(common, forgetting)
    if method == "prediction":
        return distrusted(_by_prediction(common, asked, note), common)
    return distrusted(_by_spectrum(common, asked, note), common)


def _prepared(record: Record, asked: Asked) -> Prepared:
    remarks = list(record.remarks) + list(check_record(record))
    part, said = _liveliest(record)
    remarks += said
    scale = (float(np.std(part.command)), float(np.std(part.position)))
    centred = (part.command - part.command.mean(), part.position - part.position.mean())
    hold = "first-order" if asked.hold == "first-order" else "zero-order"
    samples = Samples(centred[0] / scale[0], centred[1] / scale[1], part.rate_hz, hold)  # type: ignore[arg-type]
    excitation = excitation_report(samples.command, samples.rate_hz, (asked.order or 2) + 1)
    require_excitation(excitation)
    response = empirical_response(samples.command, samples.position, samples.rate_hz)
    remarks += check_direction(response)
    return Prepared(part, samples, scale, response, excitation, asked.quantity, asked.order, tuple(remarks))


def _liveliest(record: Record) -> tuple[Record, tuple[str, ...]]:
    count = record.command.size
    if count <= LONGEST:
        return record, ()
    power = np.cumsum((record.command - record.command.mean()) ** 2)
    starts = np.arange(0, count - LONGEST + 1, LONGEST // 4)
    best = int(starts[np.argmax(power[starts + LONGEST - 1] - power[starts])])
    piece = slice(best, best + LONGEST)
    said = (
        f"of {record.duration_s:.4g} s the {LONGEST / record.rate_hz:.4g} s from {best / record.rate_hz:.4g} s are used"
    )
    return replace(record, command=record.command[piece], position=record.position[piece], reference=None), (said,)


def _by_prediction(common: Prepared, asked: Asked, note: Callable[[str], None]) -> Identification:
    if not asked.is_free or (asked.order or 1) > 6 or asked.hold == "band-limited":
        raise BadInput("zeros, integrators, a dead time, more than six poles or a band-limited command; allowed: none "
                       "of these with the method 'prediction'")  # fmt: skip
    found = choose_structure(
        common.samples,
        common.response,
        order=asked.order,
        integrated=DERIVATIVES[asked.quantity],
        friction=asked.friction,
        note=note,
    )
    made = refined(common, judge(common.samples, found.fit, found.tests), found.tried)
    return replace(made, between=BetweenSamples(common.samples.hold, "asked"))


def _by_spectrum(common: Prepared, asked: Asked, note: Callable[[str], None]) -> Identification:
    holds, source = _holds(common.record, asked)
    if asked.may_be_motor:
        motor = motor_identification(common, BetweenSamples(holds[0], source, len(holds) == 1))
        if motor is not None:
            return motor
    known = by_spectrum.known_of(asked.quantity, asked.order, asked.zeros, asked.integrators, asked.delay_s)
    found = by_spectrum.spectral_estimate(common, holds, known, note)
    between = BetweenSamples(found.chosen.hold, source, source != "data" or found.certain, found.advantage)
    may_be_held = between.hold != "band-limited" or not between.certain
    if asked.friction and may_be_held and asked.is_free and (asked.order or 1) <= 6:
        note("looking for friction")
        if by_spectrum.friction_shows(common, found):
            made = _by_prediction(common, asked, note)
            if made.friction is not None:
                return by_spectrum.with_doubt(made, found, between)
    return by_spectrum.identification(common, found, between)


def _holds(record: Record, asked: Asked) -> tuple[tuple[Between, ...], str]:
    """The holds to try, and who says so: the user, the record's own file, or the data."""
    if asked.hold != "auto":
        return tuple(hold for hold in HOLDS if hold == asked.hold), "asked"
    written = tuple(hold for hold in HOLDS if hold == record.about.get("hold"))
    return (written, "file") if written else (("zero-order", "band-limited"), "data")
