"""From samples to a choice under each hold, and which hold it was."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.identification.spectral.hold import Hold
from tactuator.identification.spectral.joined import join, join_local
from tactuator.identification.spectral.likelihood import SpectralFit
from tactuator.identification.spectral.lines import (
    LocalResponse,
    Spectrum,
    equations,
    local_response,
    points,
    spectrum,
)
from tactuator.identification.spectral.search import Choice, Known, choose, propose

CERTAIN = 12.0
"""Difference of -2 log likelihood from which on a hold is told: odds of 1 : 400 on equal terms."""
_FAR = 300.0
"""The same from which on the worse hold is not looked at more closely."""
_SILENT = 1e-6
"""Power of the command's lines, over their median, below which the response is not looked at."""
_NO_FORM = "no model of the form asked for fits the record at all; allowed: another order, or more zeros"


@dataclass(frozen=True, eq=False)
class SpectralEstimate:
    """An estimate over lines. chosen: under the better hold, or the first one where the record does not tell them apart
    (certain). other: under the other, or None. advantage: how much better the better one's criterion is. local: the
    records' own response; spectra: of each record as it is. before: the fit to the command as it is, where what follows
    a loop's reference was fitted in its stead.
    """

    chosen: Choice
    other: Choice | None
    certain: bool
    advantage: float
    local: LocalResponse
    spectra: tuple[Spectrum, ...]
    before: SpectralFit | None = None

    @property
    def spacing_hz(self) -> float:
        """Return the distance between lines of the longest record."""
        return min(one.spacing_hz for one in self.spectra)


@np.errstate(all="ignore")
def estimate(
    signals: Sequence[tuple[FloatArray, FloatArray]],
    rate_hz: float,
    holds: tuple[Hold, ...],
    known: Known,
    note: Callable[[str], None] = lambda _: None,
) -> SpectralEstimate:
    """Return the estimate from (command, position), each (n,) and of about unit size, of every record.

    Raises BadInput where no form gives a start.
    """
    whole = [spectrum(command, position, rate_hz) for command, position in signals]
    local = join_local([local_response(one, 0.47 * rate_hz) for one in whole])
    if local.frequency_hz.size < 4:
        raise BadInput(
            f"the record shows its response at {local.frequency_hz.size} frequencies; allowed: 4 or more (a longer "
            "record, or a command with more lines)"
        )
    local = local.at(local.excitation > _SILENT * float(np.median(local.excitation)))
    proposals = _proposals(local, rate_hz, holds, known, note)
    # what was commanded before the record began is unknown for as long as the dead time: the position starts later
    shift = max(min(int(proposals[hold][0].delay_s * rate_hz + 1e-3) for hold in holds) - 1, 0)
    shift = min(shift, *(command.size // 4 for command, _ in signals))
    taken = tuple([spectrum(*one, rate_hz, shift) for one in signals] if shift else whole)
    given = join([equations(one, 0.0, 0.5 * rate_hz) for one in taken])
    choices: list[Choice] = []
    for hold in sorted(holds, key=lambda one: proposals[one][0].cost):
        note(f"fitting the record as {hold}")
        glance = choose(given, proposals[hold], hold, known, quick=True) if choices else None
        if glance is not None and glance.evidence > choices[0].evidence + _FAR:
            choices.append(glance)
            continue
        choices.append(choose(given, proposals[hold], hold, known, begun=glance))
    return _decided(choices, holds, local, taken)


@np.errstate(all="ignore")
def estimate_lines(
    local: LocalResponse,
    signals: Sequence[tuple[FloatArray, FloatArray]],
    rate_hz: float,
    holds: tuple[Hold, ...],
    known: Known,
    note: Callable[[str], None] = lambda _: None,
) -> SpectralEstimate:
    """Return the estimate from a response at single lines that no transient disturbs, its variance known; signals: the
    records that it comes from.

    Raises BadInput where no form gives a start.
    """
    proposals = _proposals(local, rate_hz, holds, known, note)
    given = points(local.frequency_hz, local.value, rate_hz)
    weight = 1.0 / np.sqrt(local.variance)
    choices = [choose(given, proposals[hold], hold, known, weight=weight) for hold in holds]
    return _decided(choices, holds, local, tuple(spectrum(command, position, rate_hz) for command, position in signals))


def _proposals(
    local: LocalResponse, rate_hz: float, holds: tuple[Hold, ...], known: Known, note: Callable[[str], None]
) -> dict[Hold, list[SpectralFit]]:
    """Return the starts of every hold. Raises BadInput where a hold has none."""
    scale = 2.0 * np.pi * float(np.exp(np.mean(np.log(local.frequency_hz))))
    proposals = propose(local, rate_hz, scale, holds, known, note)
    if not all(proposals[hold] for hold in holds):
        raise BadInput(_NO_FORM)
    return proposals


def _decided(
    choices: list[Choice], holds: tuple[Hold, ...], local: LocalResponse, taken: tuple[Spectrum, ...]
) -> SpectralEstimate:
    choices = sorted(choices, key=lambda one: one.evidence)
    if len(choices) == 1:
        return SpectralEstimate(choices[0], None, True, np.inf, local, taken)
    advantage = choices[1].evidence - choices[0].evidence
    certain = bool(advantage > CERTAIN)
    if not certain:
        # most commands come from a converter: without evidence it is taken to hold
        choices.sort(key=lambda one: holds.index(one.hold))
    return SpectralEstimate(choices[0], choices[1], certain, float(advantage), local, taken)
