"""From a record to a model with its uncertainty: align, check, response, propose, fit, friction, judge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tactuator.errors import BadInput
from tactuator.identification.alignment import align, moved_between
from tactuator.identification.check import Prepared, check
from tactuator.identification.data import Data, response_of, response_of_periods
from tactuator.identification.distortion import distortion_of_periods
from tactuator.identification.fit import (
    CERTAIN,
    SpectralEstimate,
    Starts,
    fit,
    fit_to_reference,
    glance,
    propose_starts,
)
from tactuator.identification.form import Known
from tactuator.identification.friction import fit_friction
from tactuator.identification.hold import HOLDS, Hold
from tactuator.identification.judge import identification, judge
from tactuator.identification.options import IdentifyOptions, solvable
from tactuator.identification.recursive import recursive
from tactuator.identification.result import Identification
from tactuator.processors import single_threaded
from tactuator.signals.record import Record


@np.errstate(all="ignore")
def identify(
    record: Record | Sequence[Record],
    *,
    note: Callable[[str], None] = lambda _: None,
    warn: Callable[[str], None] = lambda _: None,
    **given: Any,
) -> Identification:
    """Return a continuous model of a record, or of several records of one mechanism at one rate.

    note: receives the step at hand; warn: why the model will not be trusted, where that is known before it is fitted.
    given: the fields of `IdentifyOptions`. Several records are for the method "refined" alone. Raises BadInput for a
    record that does not show a model.
    """
    records = [record] if isinstance(record, Record) else list(record)
    options = IdentifyOptions(**given).of(records[0].about)
    if options.method != "refined" and len(records) > 1:
        raise BadInput(f"{len(records)} records with the method {options.method!r}", "several with 'refined' alone")
    with single_threaded(scipys=False), solvable():
        parts, remarks = align(records)
        common = check(parts, options, remarks)
        for row in common.checks:
            if row.refuses:
                warn(f"{row.name}, {row.where.partition(':')[0]}".rstrip(", "))
        found = recursive(common) if options.method == "rls" else _refined(common, note)
        return judge(found, common)


def _refined(common: Prepared, note: Callable[[str], None]) -> Identification:
    options, known = common.options, common.options.known(common.gain)
    holds, source = _holds(common.records[0], options)
    distortion = distortion_of_periods(common.records, common.signals, common.references)
    if distortion is None:
        data = response_of(common.signals, common.rate_hz)
    else:
        data = response_of_periods(distortion.local, common.signals, common.rate_hz)
    prompt = data
    data, starts, first = _begin(data, holds, known, note)
    # a command recorded behind a filter runs ahead of its own past
    if distortion is None and common.in_loop is not False and holds != ("band-limited",):
        suspected = first.chosen.fit.growth > 0.0 or common.in_loop is True
        # read later by a dead time that the noise feigned, a position would follow commands that are yet to come
        causal = prompt.beside_loop(suspected=suspected)
        if causal is not None:
            note("a loop may have answered the noise: starting from an autoregressive response")
            other = _begin(causal, holds, known, note)
            if other[2].evidence < first.evidence + (CERTAIN if suspected else -CERTAIN):
                data, starts, first = other
    if source == "data":
        _require_held(common, holds, known, first if distortion is None else None)
    friction = None
    if options.friction and distortion is None and common.references is None:
        friction = fit_friction(first, holds, known, note)
    estimate = friction.estimate if friction is not None else fit(data, starts, known, note, first)
    if estimate.chosen.hold == "band-limited" and common.references is not None and distortion is None:
        note("fitting what follows the reference")
        estimate = fit_to_reference(estimate, common.references)
    return identification(
        common, estimate, source, None if distortion is None else distortion.scaled(common.gain), friction
    )


def _require_held(common: Prepared, holds: tuple[Hold, ...], known: Known, first: SpectralEstimate | None) -> None:
    """Raise BadInput for commands that repeat their values, unless it is certain that they were held meanwhile: one
    that was logged more slowly than the position had moved on by then, and the model would lead by that time.

    first: a glance at the records as they are, if there is one.
    """
    between = [moved_between(command) for command, _ in common.signals]
    if all(command is None for command in between):
        return
    joined = [
        (was if command is None else command, position)
        for command, (was, position) in zip(between, common.signals, strict=True)
    ]
    plain, moving = (
        _begin(response_of(signals, common.rate_hz), holds, known, lambda _: None)[2] if seen is None else seen
        for signals, seen in ((common.signals, first), (joined, None))
    )
    command = common.signals[next(k for k, each in enumerate(between) if each is not None)][0]
    each = command.size / (1.0 + np.count_nonzero(np.diff(command)))
    ahead = moving.evidence - plain.evidence
    if not ahead > CERTAIN:
        moved = "the position answers one that went on" if ahead < -CERTAIN else "it may have gone on"
        raise BadInput(
            f"the command repeats its values, {each:.3g} samples each, and {moved} between them",
            "a command logged as often as the position, or `hold` zero-order if it was held",
        )


def _begin(
    data: Data, holds: tuple[Hold, ...], known: Known, note: Callable[[str], None]
) -> tuple[Data, Starts, SpectralEstimate]:
    """Return the data, read as late as their dead time, with where to start and a glance at what comes of it."""
    starts = propose_starts(data, holds, known.without_values, note)
    data = data.read_later(max(fits[0].delay_s for fits in starts.values()))
    return data, starts, glance(data, starts, known)


def _holds(record: Record, options: IdentifyOptions) -> tuple[tuple[Hold, ...], str]:
    """Return the holds to try, and who says so: the user, the record's own file, or the data."""
    if options.hold != "auto":
        return (options.hold,), "asked"
    written = tuple(hold for hold in HOLDS if hold == record.about.get("hold"))
    return (written, "file") if written else (("zero-order", "band-limited"), "data")
