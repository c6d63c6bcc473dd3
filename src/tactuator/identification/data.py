"""What a model is fitted to: records, or a response by itself; and how a fit weighs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.identification.autoregressive import autoregressive_response
from tactuator.identification.hold import Grid, Hold
from tactuator.identification.likelihood import SpectralFit, SpectralProblem
from tactuator.identification.lines import (
    HIGHEST,
    Equations,
    JoinedEquations,
    LocalResponse,
    Spectrum,
    equations_of,
    join_local,
    local_response,
    points,
    spectrum,
    weights,
)
from tactuator.signals.spectra import mean_over_frequency

Signals = Sequence[tuple[FloatArray, FloatArray]]
"""Command and position, (n,) each, of every record."""
HIGHEST_OF = {"zero-order": 0.4999, "first-order": 0.4999, "band-limited": HIGHEST}
"""Highest line used over the rate: the flank of an anti-alias filter says nothing."""
_LATE = 100
"""Dead time, samples, from which on its turning of the phase spoils a local response that does not know of it."""
_SILENT = 1e-6
"""Power of the command's lines, over their median, below which the response is not looked at."""
_NOTHING = 1e-10
"""The same over the strongest line: there is rounding and leakage alone."""


_AS_GOOD, _DEPARTS = 0.02, 1.3
"""Relative error up to which an autoregressive response is as good as any to begin from; its mean squared departure
from the records' own, in their errors, from which on a loop may be why: 1.13 at most in 16 records outside a loop."""


@dataclass(frozen=True, eq=False)
class Data:
    """What a model is fitted to: a response, or the records that show one.

    given_local: frequencies, values and their variance; None: those that the records show. signals, spectra:
    samples and lines of each record (none of a response by itself). weight: one over the deviation of each value,
    where it is known; of a record it comes from the residual. late_s: about how much later than the command the
    position begins to answer. kind: the problem that a fit solves. in_loop: whether the response is one that a loop
    leaves unbiased, of which poles may grow.
    """

    given_local: LocalResponse | None
    rate_hz: float
    signals: Signals = ()
    spectra: tuple[Spectrum, ...] = ()
    weight: FloatArray | None = None
    late_s: float = 0.0
    kind: type[SpectralProblem] = SpectralProblem
    in_loop: bool = False
    skewed: bool = True

    @cached_property
    def local(self) -> LocalResponse:
        """Return the response that is fitted to, or that the records show by themselves."""
        return self.given_local or local_of(self.spectra, self.rate_hz)

    @property
    def may_be_skewed(self) -> bool:
        """Return whether the positions may have been read later than the commands: what follows from a loop's noise
        would seem to be.
        """
        return self.skewed and not self.in_loop and bool(self.signals)

    @property
    def scale_rad_s(self) -> float:
        """Return the unit of scaled frequency: the middle of those at which the response is known."""
        return 2.0 * np.pi * float(np.exp(np.mean(np.log(self.local.frequency_hz))))

    @cached_property
    def given(self) -> Equations | JoinedEquations:
        """Return the equations of a fit."""
        if self.weight is not None:
            return points(self.local.frequency_hz, self.local.value, self.rate_hz)
        return equations_of(self.spectra)

    def problem(self, scale_rad_s: float, hold: Hold, *, stable: bool = False) -> SpectralProblem:
        """Return the problem of a fit under a hold; of records its lines have equal weights."""
        given, known = self.given, 1.0 if self.weight is None else self.weight
        weight = np.where(given.of_hz <= HIGHEST_OF[hold] * self.rate_hz, known, 0.0)
        grid = Grid(given.frequency_hz, self.rate_hz, scale_rad_s, hold, given.shift)
        transient, skewed = self.weight is None, self.may_be_skewed
        return self.kind(given, weight, grid, with_transient=transient, stable=stable, skewed=skewed)

    def weighted(self, problem: SpectralProblem, fit: SpectralFit) -> SpectralProblem:
        """Return the problem weighted by what a fit leaves of the records."""
        if self.weight is not None:
            return problem
        highest_hz = HIGHEST_OF[problem.grid.hold] * self.rate_hz
        residual = problem.residual(fit)
        if self.in_loop:
            # lines over which the noise's power is averaged in a loop, at least. A loop turns what the weights
            # flatten into bias: within 40 lines of a short record a slow force, which the command follows, falls by
            # decades
            weight = weights(self.given, residual, highest_hz, fit.ringing, 12)
        else:
            weight = weights(self.given, residual, highest_hz)
        return replace(problem, weight=weight)

    def beside_loop(self, *, suspected: bool) -> Data | None:
        """Return the records with the response that a loop leaves unbiased, where one is suspected or that response
        departs from the one that they show by themselves; None otherwise.
        """
        plain, causal = self.local, autoregressive_response(self.spectra, self.local)
        if causal is None:
            return None
        spread = causal.variance + plain.variance + (_AS_GOOD * np.abs(causal.value)) ** 2
        departs = float(np.mean(np.abs(causal.value - plain.value) ** 2 / spread)) > _DEPARTS
        return replace(self, given_local=causal, in_loop=True) if suspected or departs else None

    def with_commands(self, signals: Signals) -> Data:
        """Return the data of the same positions under other commands."""
        spectra = tuple(was.under(command) for was, (command, _) in zip(self.spectra, signals, strict=True))
        return replace(self, signals=signals, spectra=spectra, given_local=None)

    def read_later(self, delay_s: float) -> Data:
        """Return the data with the positions read as much later as a dead time, but a sample.

        What was commanded before the record began is unknown for as long as the dead time.
        """
        if self.weight is not None:
            return self
        spectra = spectra_read_late(self.signals, self.rate_hz, delay_s)
        shift = abs(spectra[0].shift - self.spectra[0].shift)
        if shift == 0:
            return self
        return replace(self, spectra=spectra, given_local=None if shift > _LATE else self.local)


def response_of(signals: Signals, rate_hz: float) -> Data:
    """Return the response that records show by themselves, and their lines."""
    whole = tuple(spectrum(command, position, rate_hz) for command, position in signals)
    arrival = _arrival(whole[0])
    taken = tuple(spectrum(*pair, rate_hz, arrival) for pair in signals) if arrival > _LATE else whole
    return Data(None, rate_hz, signals, taken, late_s=arrival / rate_hz)


def response_of_periods(local: LocalResponse, signals: Signals, rate_hz: float) -> Data:
    """Return a response at single lines that no transient disturbs, its variance known, of records with such lines."""
    taken = tuple(spectrum(command, position, rate_hz) for command, position in signals)
    return Data(local, rate_hz, signals, taken, weight=1.0 / np.sqrt(local.variance))


def spectra_read_late(signals: Signals, rate_hz: float, delay_s: float) -> tuple[Spectrum, ...]:
    """Return the lines of records with the positions read later by a dead time, but a sample, a quarter at most."""
    shift = max(min(int(delay_s * rate_hz + 1e-3) - 1, *(command.size // 4 for command, _ in signals)), 0)
    return tuple(spectrum(*pair, rate_hz, shift) for pair in signals)


def _arrival(taken: Spectrum) -> int:
    """Return about how many samples pass before the position answers the command: when the impulse response that the
    lines show by themselves first rises to a tenth of its greatest; 0 where it is hidden by the noise.
    """
    power = np.abs(taken.command) ** 2
    lines = np.conj(taken.command) * taken.position / (power + 0.01 * float(np.max(mean_of_lines(power))))
    impulse = np.abs(np.fft.irfft(lines, taken.samples))[: taken.samples // 4]
    tenth = 0.1 * float(np.max(impulse))
    # tenth of an impulse response's peak over its median, from which on its beginning can be seen
    if not tenth > 4.0 * float(np.median(impulse)):
        return 0
    return max(int(0.9 * float(np.argmax(impulse > tenth))) - 10, 0)


def local_of(taken: tuple[Spectrum, ...], rate_hz: float) -> LocalResponse:
    """Return the records' own response where their command has power. Raises BadInput where that is nearly nowhere."""
    local = join_local([local_response(spectrum_, HIGHEST * rate_hz) for spectrum_ in taken])
    if local.frequency_hz.size < 4:
        raise BadInput(
            f"the record shows its response at {local.frequency_hz.size} frequencies",
            "4 or more (a longer record, or a command with more lines)",
        )
    blindness = local.blindness
    # how much less sure a response may be than its command's power allows, over the surest: between sines, where the
    # command's lines are as smooth as a transient, it is 1e10 and more, at the slow end of a chirp 4e4, in noise 4
    local = local.at(blindness <= max(1e6 * float(np.min(blindness)), float(np.sort(blindness)[3])))
    power = local.excitation
    return local.at(power > max(_SILENT * float(np.median(power)), _NOTHING * float(np.max(power))))


_NEAR = 40
"""Lines over which powers are averaged: they may fall by much towards half the rate, and all is lost in a wide mean."""


def mean_of_lines(power: FloatArray) -> FloatArray:
    """Return the mean power of the 40 lines that each of some lines belongs to, (m,)."""
    place = np.arange(float(power.size))
    middle = np.minimum(np.arange(_NEAR // 2, power.size + _NEAR // 2, _NEAR), power.size - 1)
    return np.repeat(mean_over_frequency(power, place, place[middle], fewest=_NEAR), _NEAR)[: power.size]
