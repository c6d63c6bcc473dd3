"""From samples to a choice under each hold, and which hold it was.

A recorded reference serves as instrument: the part of a loop's command that follows it is free of the loop's own noise
(Van den Hof and Schrama, An indirect method for transfer function estimation from closed loop data, 1993, in two
stages, with a local polynomial estimate for the first stage).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.identification.data import Data, Signals, spectra_read_late
from tactuator.identification.form import Known, is_stable
from tactuator.identification.hold import Hold
from tactuator.identification.likelihood import SpectralFit
from tactuator.identification.lines import (
    HIGHEST,
    Equations,
    JoinedEquations,
    LocalResponse,
    Spectrum,
    band_edges,
    equations_of,
    weights,
)
from tactuator.identification.residual import Residual, choice_of_model, joint_misfit, record_residual
from tactuator.identification.search import Choice, choose, propose, simplest
from tactuator.identification.uncertainty import indistinct

Starts = dict[Hold, list[SpectralFit]]
"""Fits to the response, best first, of each hold in the order in which one is taken if the data cannot tell."""
CERTAIN = 12.0
"""Difference of -2 log likelihood from which on a hold is stated: odds of 1 : 400 on equal terms."""
_FAR = 300.0
"""Difference of -2 log likelihood from which on the worse hold is not looked at more closely."""
_BANDS, _FREE = 60, 1.6
"""Bands in which a residual is held against the command, and what they follow it by, on the mean, from which on no hold
is stated: 1.46 at most where the form was right, 1.75 at least beside half-order parts."""


@dataclass(frozen=True, eq=False)
class SpectralEstimate:
    """An estimate over lines. chosen: under the better hold; where the record does not separate them (certain) under
    the band-limited one if command and position passed filters (flanks), else under the first one. other: under the
    other, or None. advantage: how much better the better one's criterion is; enough: from which on it is stated. local:
    the records' own response; spectra: of each record as it is. residuals, other_residuals: what the two leave of every
    record (of single lines: none). before: the fit to the command as it is, where what follows a loop's reference was
    fitted in its stead. free: the estimate without the values that are known, where there are any. trials: of a glance
    the choice under every hold.
    """

    chosen: Choice
    other: Choice | None
    certain: bool
    advantage: float
    enough: float
    data: Data
    residuals: tuple[Residual, ...] = ()
    other_residuals: tuple[Residual, ...] = ()
    before: SpectralFit | None = None
    flanks: bool = False
    free: SpectralEstimate | None = None
    trials: tuple[_Trial, ...] = ()

    @property
    def evidence(self) -> float:
        """Return the criterion of a glance's better hold, growing poles paid for as in a descent."""
        seconds = sum(part.samples / part.rate_hz for part in self.spectra)
        return min(trial.evidence for trial in self.trials) + 2.0 * seconds * self.chosen.fit.growth

    @property
    def local(self) -> LocalResponse:
        """Return the response that was fitted to, or that the records show by themselves."""
        return self.data.local

    @property
    def spectra(self) -> tuple[Spectrum, ...]:
        """Return the lines of every record."""
        return self.data.spectra


def glance(data: Data, starts: Starts, known: Known) -> SpectralEstimate:
    """Return the better of the two most likely forms alone, whatever values are known: enough to see friction by."""
    tried = [choose(data, starts[hold], hold, known.without_values, quick=True) for hold in starts]
    trials = [_tried(choice, data) for choice in tried]
    return replace(_decided(trials, tuple(starts), data), trials=tuple(trials))


def fit(
    data: Data,
    starts: Starts,
    known: Known,
    note: Callable[[str], None] = lambda _: None,
    begun: SpectralEstimate | None = None,
) -> SpectralEstimate:
    """Return the estimate of a response or of records: under each hold the simplest form of the best ones.

    starts: fits without the values that are known; begun: a glance at them, to go on from. Raises BadInput where no
    form gives a start.
    """
    free = _best_of(data, starts, known.without_values, note, begun)
    if known == known.without_values:
        return free
    note("fitting with the values that are known")
    return replace(_best_of(data, propose_starts(data, tuple(starts), known, note, free), known, note), free=free)


def refit(data: Data, before: SpectralEstimate, known: Known, note: Callable[[str], None]) -> SpectralEstimate:
    """Return the estimate of data that hardly differ from those of another estimate, begun from its fits."""
    free = _best_of(data, _fits_of(before.free or before), known.without_values, note)
    return free if before.free is None else replace(_best_of(data, _fits_of(before), known, note), free=free)


def _best_of(
    data: Data,
    starts: Starts,
    known: Known,
    note: Callable[[str], None],
    begun: SpectralEstimate | None = None,
) -> SpectralEstimate:
    glances = {} if begun is None else {trial.choice.hold: trial for trial in begun.trials}
    tried: list[_Trial] = []
    for hold in sorted(starts, key=lambda choice: starts[choice][0].cost):
        note(f"fitting the record as {hold}")
        tried.append(_searched(data, starts[hold], hold, known, tried, glances.get(hold)))
    return simplified(_decided(tried, tuple(starts), data), known)


def no_form() -> BadInput:
    """Return the refusal of a form that gives no start."""
    return BadInput("no model of the form asked for fits", "another order, or more zeros")


def _fits_of(before: SpectralEstimate) -> dict[Hold, list[SpectralFit]]:
    """Return the fits of an estimate, the chosen ones first, by hold."""
    choices = [choice for choice in (before.chosen, before.other) if choice is not None]
    return {
        choice.hold: [choice.fit, *(fit for fit in choice.fits.values() if fit is not choice.fit)] for choice in choices
    }


def _searched(
    data: Data,
    proposals: list[SpectralFit],
    hold: Hold,
    known: Known,
    found: list[_Trial],
    seen: _Trial | None,
) -> _Trial:
    """Return the best choice under one hold, after a glance alone if that is far behind what was `found` before."""
    if found:
        seen = seen or _tried(choose(data, proposals, hold, known, quick=True), data)
        if seen.evidence > found[0].evidence + _FAR and found[0].fits:
            return seen
    begun = None if seen is None else seen.choice
    best = _tried(choose(data, proposals, hold, known, begun=begun), data)
    if best.choice.fit.delay < 0.0 and (best.by_loop > 0.0 or not best.fits):
        # neither what follows from a loop's noise nor what a form lacks shows how the channels were read
        data = replace(data, skewed=False)
        best = _tried(choose(data, proposals, hold, known), data)
    behind = bool(found) and best.evidence > found[0].evidence + _enough(best, found[0])
    if is_stable(best.choice.fit.theta, best.choice.fit.form) or behind:
        return best
    # in a loop a model that is not causal takes the noise in the command for an answer
    mirrored = [replace(fit, theta=np.abs(fit.theta)) for fit in (best.choice.fit, *proposals)]
    stable = _tried(choose(data, mirrored, hold, known, stable=True), data)
    if stable.evidence > best.evidence + CERTAIN:
        return best
    if stable.evidence > best.evidence - CERTAIN:
        stable = replace(stable, choice=replace(stable.choice, rival=best.choice.fit))
    return stable


def propose_starts(
    data: Data,
    holds: tuple[Hold, ...],
    known: Known,
    note: Callable[[str], None] = lambda _: None,
    free: SpectralEstimate | None = None,
) -> Starts:
    """Return the fits to the response under every hold to start from; free: the estimate without the values that are
    known. Raises BadInput where a hold has none.
    """
    starts = propose(data, holds, known, note, {} if free is None else _fits_of(free))
    if not all(starts[hold] for hold in holds):
        raise no_form()
    return starts


@dataclass(frozen=True, eq=False)
class _Trial:
    """A choice, what it leaves of every record (of single lines: none), and whether those may have been in a loop."""

    choice: Choice
    residuals: tuple[Residual, ...]
    in_loop: bool

    @cached_property
    def _parts(self) -> list[tuple[float, float]]:
        filtered = self.choice.hold == "band-limited"
        return [joint_misfit(rest, HIGHEST * rest.taken.rate_hz, filtered=filtered) for rest in self.residuals]

    @property
    def evidence(self) -> float:
        """Return the criterion (Bayes) for position and command together, by which holds are compared."""
        misfit = sum(part for part, _ in self._parts) if self.residuals else 2.0 * self.choice.fit.cost
        return misfit + float(np.log(self.choice.problem.given.total)) * self.choice.fit.form.count

    @property
    def by_loop(self) -> float:
        """Return how much of it a loop explains."""
        return sum(by_loop for _, by_loop in self._parts)

    @cached_property
    def fits(self) -> bool:
        """Return whether the residual is free of the command, which in a loop it cannot be: a form that does not fit
        takes the other hold's half sample for what it lacks.
        """
        return (self.in_loop and self.by_loop > 0.0) or max(map(_follows, self.residuals), default=0.0) < _FREE


def _follows(residual: Residual) -> float:
    """Return the mean over bands of how far the residual's lines follow the command's, 1 where by chance alone."""
    edges = np.linspace(0, residual.lines.size - 1, _BANDS + 1).astype(np.int64)
    command, rest = residual.taken.command[1:], residual.lines[1:]
    sums = [
        np.add.reduceat(row, edges[:-1]) for row in (np.conj(command) * rest, np.abs(command) ** 2, np.abs(rest) ** 2)
    ]
    along = np.abs(sums[0]) ** 2 / np.maximum(sums[1].real * sums[2].real, 1e-300)
    return float(np.mean(along * np.diff(edges)))


def _tried(choice: Choice, data: Data) -> _Trial:
    return _Trial(choice, record_residual(choice, data.spectra) if data.weight is None else (), data.in_loop)


def _enough(trial: _Trial, other: _Trial) -> float:
    """Return the difference of evidence from which on one of two holds is stated."""
    if trial.in_loop:
        # where a loop misled the response: of 80 drawn loops one spoke for the wrong hold by 176; right ones do by
        # 1000
        return 300.0
    # where a loop shows, two lags more or less of the filter that represents it make twenty
    return 36.0 if max(trial.by_loop, other.by_loop) > 0.0 else CERTAIN


def _decided(tried: list[_Trial], holds: tuple[Hold, ...], data: Data) -> SpectralEstimate:
    """Return the estimate under the hold of the better evidence; of two alike the one that the filters speak for."""
    best, *others = tried if len(tried) == 1 else sorted(tried, key=lambda row: row.evidence)
    if not others:
        return SpectralEstimate(best.choice, None, True, np.inf, CERTAIN, data, best.residuals)
    other = others[0]
    advantage = float(other.evidence - best.evidence) if best.fits else 0.0
    enough, flanks = _enough(best, other), False
    certain = advantage > enough
    if not certain:
        flanks = bool(best.residuals) and _flanks(data.spectra, best.residuals)
        # most commands come from a converter: without evidence the command is taken to be held
        likely = "band-limited" if flanks else min(holds, key=holds.index)
        best, other = (best, other) if best.choice.hold == likely else (other, best)
    return SpectralEstimate(
        best.choice,
        other.choice,
        certain,
        advantage,
        enough,
        data,
        best.residuals,
        other.residuals,
        flanks=flanks,
    )


def simplified(estimated: SpectralEstimate, known: Known, shifts: FloatArray | None = None) -> SpectralEstimate:
    """Return the estimate with the simplest form whose response lies within the band of the best one's.

    shifts: deviations of its parameters beside the noise's, as in `indistinct`.
    """
    before, distinct = estimated.chosen, True
    while distinct:
        chosen, distinct = simplest(before, known, indistinct(before, estimated.local, shifts))
        if distinct and shifts is not None:
            return estimated  # the deviations are those of the form before
        before = refitted(chosen, chosen.problem.given) if distinct and estimated.residuals else chosen
    if chosen is estimated.chosen:
        return estimated
    residuals = record_residual(chosen, estimated.spectra) if estimated.residuals else ()
    return replace(estimated, chosen=chosen, residuals=residuals)


def _flanks(taken: Sequence[Spectrum], residuals: Sequence[Residual]) -> bool:
    """Return true where the command, and what no command explains of the position, both fall off below half the rate
    as behind the filters of converters: the command was then recorded, not played.
    """

    def falls(lines: ComplexArray, place: FloatArray) -> bool:
        below, beyond = (
            float(np.mean(np.abs(lines[(place > low) & (place < high)]) ** 2))
            for low, high in ((0.35, 0.40), (0.46, 0.495))
        )
        # power below a filter's edge over that beyond it, from which on a signal is taken to have passed one (12 dB)
        return below > 15.0 * beyond

    return all(
        falls(lines, taken_.frequency_hz / taken_.rate_hz)
        for taken_, rest in zip(taken, residuals, strict=True)
        for lines in (taken_.command, rest.lines)
    )


_SHARE, _FEWEST = 0.04, 30
"""Width of a band over the frequency, and its lines, of which six take part of the noise with them: a fifth at most."""
REMAINS = 0.3
"""Share of what the reference changed that may still be amiss: the bands' own six of thirty lines, and chance."""


def fit_to_reference(estimated: SpectralEstimate, references: Sequence[FloatArray]) -> SpectralEstimate:
    """Return the estimate with its chosen forms fitted to what follows the references (n,), if that is enough."""
    choice, pairs = estimated.chosen, list(zip(estimated.spectra, references, strict=True))
    if not all(follows_reference(*pair) for pair in pairs):
        return estimated
    given = equations_of(by_reference(*pair) for pair in pairs)
    chosen = refitted(choice, given)
    residuals = record_residual(chosen, estimated.spectra)
    return replace(estimated, chosen=chosen, residuals=residuals, before=choice.fit)


def estimate_of_model(fit: SpectralFit, signals: Signals) -> SpectralEstimate:
    """Return what a model is on records that it was not fitted to."""
    rate_hz = fit.grid.rate_hz
    taken = spectra_read_late(signals, rate_hz, fit.delay_s)
    choice, data = (
        choice_of_model(fit, taken, HIGHEST * rate_hz),
        Data(None, rate_hz, signals, taken),
    )
    return SpectralEstimate(choice, None, True, np.inf, CERTAIN, data, record_residual(choice, taken))


def refitted(choice: Choice, given: Equations | JoinedEquations) -> Choice:
    """Return the choice with its forms fitted to other equations at the same frequencies."""
    problem, fit = replace(choice.problem, given=given), choice.fit
    highest = float(given.of_hz[choice.problem.weight > 0.0].max())
    for _ in range(2):
        problem = replace(problem, weight=weights(given, problem.residual(fit), highest))
        fit = problem.continued(fit, 10)
    others = {form: problem.descend(form, other.theta, other.delay, most=6) for form, other in choice.fits.items()}
    kept = {form: other for form, other in others.items() if other is not None}
    return replace(choice, fit=fit, problem=problem, fits=kept | {fit.form: fit})


def follows_reference(taken: Spectrum, reference: FloatArray) -> bool:
    """Return true where enough of the command follows the reference (n,)."""
    followed = by_reference(taken, reference)
    power = float(np.sum(np.abs(taken.command) ** 2))
    # share of the command's power that must follow the reference for it to be of use
    return float(np.sum(np.abs(followed.command) ** 2)) > (0.3 + 6.0 / _FEWEST) * power


def by_reference(taken: Spectrum, reference: FloatArray) -> Spectrum:
    """Return the spectrum with the command's lines replaced by what follows the reference (n,), transient included."""
    early = reference[: taken.samples]
    driver = np.fft.rfft(early - early.mean()) / np.sqrt(taken.samples)
    command = taken.command.copy()
    for begin, end in band_edges(taken.samples, 1, taken.command.size, _SHARE, _FEWEST, widest=1.0):
        place = np.linspace(-1.0, 1.0, end - begin)
        shape = np.stack([np.ones_like(place), place, place * place], axis=1)
        columns = np.hstack([driver[begin:end, None] * shape, shape])
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        basis, values, _ = np.linalg.svd(columns / size, full_matrices=False)
        basis = basis[:, values > 1e-9 * values[0]]
        command[begin:end] = basis @ (basis.conj().T @ taken.command[begin:end])
    return replace(taken, command=command)
