"""From samples to a choice under each hold, and which hold it was."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
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
from tactuator.identification.spectral.loop_evidence import explained_by_loop
from tactuator.identification.spectral.record_residual import Residual, record_residual
from tactuator.identification.spectral.search import COMPARED, Choice, Known, choose, propose

CERTAIN = 12.0
"""Difference of -2 log likelihood from which on a hold is told: odds of 1 : 400 on equal terms."""
_FLANK = 15.0
"""Power below a filter's edge over that beyond it, from which on a signal is taken to have passed one (12 dB)."""
_FAR = 300.0
"""The same from which on the worse hold is not looked at more closely."""
_SILENT = 1e-6
"""Power of the command's lines, over their median, below which the response is not looked at."""
_NO_FORM = "no model of the form asked for fits the record at all; allowed: another order, or more zeros"


@dataclass(frozen=True, eq=False)
class SpectralEstimate:
    """An estimate over lines. chosen: under the better hold; where the record does not tell them apart (certain) under
    the band-limited one if command and position passed filters (flanks), else under the first one. other: under the
    other, or None. advantage: how much better the better one's criterion is. local: the records' own response; spectra:
    of each record as it is. before: the fit to the command as it is, where what follows a loop's reference was fitted
    in its stead.
    """

    chosen: Choice
    other: Choice | None
    certain: bool
    advantage: float
    local: LocalResponse
    spectra: tuple[Spectrum, ...]
    before: SpectralFit | None = None
    flanks: bool = False

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
        if glance is not None and _joint(glance, taken) > _joint(choices[0], taken) + _FAR:
            choices.append(glance)
            continue
        choices.append(choose(given, proposals[hold], hold, known, begun=glance))
    return _decided(choices, [_joint(one, taken) for one in choices], holds, local, taken)


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
    taken = tuple(spectrum(command, position, rate_hz) for command, position in signals)
    return _decided(choices, [one.evidence for one in choices], holds, local, taken)


def _proposals(
    local: LocalResponse, rate_hz: float, holds: tuple[Hold, ...], known: Known, note: Callable[[str], None]
) -> dict[Hold, list[SpectralFit]]:
    """Return the starts of every hold. Raises BadInput where a hold has none."""
    scale = 2.0 * np.pi * float(np.exp(np.mean(np.log(local.frequency_hz))))
    proposals = propose(local, rate_hz, scale, holds, known, note)
    if not all(proposals[hold] for hold in holds):
        raise BadInput(_NO_FORM)
    return proposals


def _joint(choice: Choice, taken: tuple[Spectrum, ...]) -> float:
    """Return what two holds are compared by: the choice's criterion and that of the command given its residual."""
    highest, filtered = COMPARED * taken[0].rate_hz, choice.hold == "band-limited"
    pairs = zip(taken, record_residual(choice, taken), strict=True)
    return choice.evidence - sum(explained_by_loop(one, left, highest, filtered=filtered) for one, left in pairs)


def _decided(
    choices: list[Choice],
    evidence: list[float],
    holds: tuple[Hold, ...],
    local: LocalResponse,
    taken: tuple[Spectrum, ...],
) -> SpectralEstimate:
    """Return the estimate under the hold of the better evidence; of two alike the one that the filters speak for."""
    order = sorted(range(len(choices)), key=evidence.__getitem__)
    if len(choices) == 1:
        return SpectralEstimate(choices[0], None, True, np.inf, local, taken)
    advantage = evidence[order[1]] - evidence[order[0]]
    best, other = (choices[k] for k in order)
    if advantage > CERTAIN:
        return SpectralEstimate(best, other, True, float(advantage), local, taken)
    flanks = best.problem.with_transient and _flanks(taken, record_residual(best, taken))
    # most commands come from a converter: without evidence the command is taken to be held
    likely = "band-limited" if flanks else min(holds, key=holds.index)
    best, other = (best, other) if best.hold == likely else (other, best)
    return SpectralEstimate(best, other, False, float(advantage), local, taken, flanks=flanks)


def _flanks(taken: Sequence[Spectrum], left: Sequence[Residual]) -> bool:
    """Return true where the command, and what no command explains of the position, both fall off below half the rate
    as behind the filters of converters: the command was then recorded, not played.
    """

    def falls(lines: ComplexArray, place: FloatArray) -> bool:
        below, beyond = (
            float(np.mean(np.abs(lines[(place > low) & (place < high)]) ** 2))
            for low, high in ((0.35, 0.40), (0.46, 0.495))
        )
        return below > _FLANK * beyond

    return all(
        falls(lines, one.frequency_hz / one.rate_hz)
        for one, rest in zip(taken, left, strict=True)
        for lines in (one.command, rest.lines)
    )
