"""Response, noise and distortion of periodic records, line by line, without a model.

Noise is what differs between the periods of a realisation; distortion what a line answers that was silent in the
command, and what differs between realisations beyond the noise (Pintelon and Schoukens, System Identification: A
Frequency Domain Approach, 2012, chapter 4: the best linear approximation and its total and noise variance).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.lines import POOLED, LocalResponse
from tactuator.signals.multisine import Bins, Periods, periods_of
from tactuator.signals.record import Record
from tactuator.signals.spectra import mean_over_frequency

_FEWEST, _EXACT = 8, 1e-12
"""Lines of a mean at least, and relative error of a response beside which there is no noise: rounding."""
_REPEATED = 1e-6
"""Share of the command's power that may differ between periods of a command that nothing feeds back to."""


@dataclass(frozen=True, eq=False)
class Distortion:
    """A record's own response at the excited lines, and levels beside it, all relative to the command: as responses of
    one realisation would err, root mean square. All (m,).

    frequency_hz; value: the best linear approximation; noise: averaged over the periods; total: with the distortion;
    even, odd: distortion by the silent lines (nan where there are none); variance: of `value`, everything counted.
    realisations; repeats: whether the command repeats itself, which no command in a loop does, or None where that is
    unknown.
    """

    frequency_hz: FloatArray
    value: ComplexArray
    noise: FloatArray
    total: FloatArray
    even: FloatArray
    odd: FloatArray
    variance: FloatArray
    realisations: int
    repeats: bool | None

    @property
    def distortion(self) -> FloatArray:
        """Return the odd distortion at the excited lines: the total minus the noise; of one realisation that of the
        silent odd lines."""
        if self.realisations < 2:
            return np.nan_to_num(self.odd)
        return np.sqrt(np.maximum(self.total**2 - self.noise**2, 0.0))

    @property
    def local(self) -> LocalResponse:
        """Return the best linear approximation with its total variance, to fit to."""
        ones = np.ones(self.frequency_hz.size)
        return LocalResponse(
            self.frequency_hz, self.value, self.variance, self.total**2 / self.realisations, ones, ones
        )

    def scaled(self, gain: float) -> Distortion:
        """Return the same in other units of the response."""
        levels = {name: gain * getattr(self, name) for name in ("value", "noise", "total", "even", "odd")}
        return replace(self, **levels, variance=gain**2 * self.variance)

    @property
    def shows(self) -> bool:
        """Return whether the distortion exceeds the noise by more than chance at a tenth of the lines."""
        loudest = np.fmax(np.fmax(self.even, self.odd), self.distortion)
        return bool(np.mean(loudest > self.noise) > 0.1)


def distortion_of_periods(
    records: Sequence[Record], signals: Sequence[tuple[FloatArray, FloatArray]], references: Sequence[FloatArray] | None
) -> Distortion | None:
    """Return what periodic records show, line by line; None where one has no plan, too few lines, or another plan."""
    plans = [plan for record in records if (plan := periods_of(record.about, record.command.size)) is not None]
    if len(plans) < len(records) or plans[0].lines.size < _FEWEST:
        return None
    first = plans[0]
    alike = all(
        (plan.period, plan.repeats) == (first.period, first.repeats) and np.array_equal(plan.lines, first.lines)
        for plan in plans
    )
    return distortion_of(signals, references, plans, records[0].rate_hz) if alike else None


def distortion_of(
    signals: Sequence[tuple[FloatArray, FloatArray]],
    references: Sequence[FloatArray] | None,
    plans: Sequence[Periods],
    rate_hz: float,
) -> Distortion:
    """Return response, noise and distortion of records (command, position), each (n,), of one plan's period and lines.

    references: what a loop was asked for, of every record, or None: the response then follows it, free of noise fed
    back.
    """
    plan = plans[0]
    follow = [row[0] for row in signals] if references is None else list(references)
    blocks = [
        np.concatenate([row.blocks(values) for row, values in zip(plans, rows, strict=True)])
        for rows in (*zip(*signals, strict=True), follow)
    ]
    command, position, asked = (np.fft.rfft(block, axis=2) / plan.period for block in blocks)
    lines = plan.lines
    u, y, r = (row.mean(axis=1)[:, lines] for row in (command, position, asked))
    value = np.sum(y * np.conj(r), axis=0) / np.sum(u * np.conj(r), axis=0)
    hertz = lines * rate_hz / plan.period
    root = np.sqrt(np.mean(np.abs(u) ** 2, axis=0))
    between = _between_periods(position[:, :, lines] - value * command[:, :, lines])

    def near(power: FloatArray) -> FloatArray:
        return mean_over_frequency(power, hertz, hertz, 0.5 * POOLED, _FEWEST)

    noise = near(between)
    count = u.shape[0]
    odd, even = (
        _silent_level(position, command, silent, rate_hz / plan.period, hertz, value) for silent in plan.silent(rate_hz)
    )
    beyond = np.nan_to_num(odd) ** 2
    if count > 1:
        # distortion has the plant's shape, noise has not: each is averaged over neighbours where it is smooth
        seen, each = np.abs(value) ** 2, np.sum(np.abs(y - value * u) ** 2, axis=0) / (count - 1.0)
        beyond = near((each - between) / seen) * seen
    total = noise + np.maximum(beyond, 0.0)
    return Distortion(
        frequency_hz=hertz,
        value=value,
        noise=np.sqrt(noise) / root,
        total=np.sqrt(total) / root,
        even=even / root,
        odd=odd / root,
        variance=total / (count * root**2) + (_EXACT * np.abs(value)) ** 2,
        realisations=count,
        repeats=_repeats(command, lines),
    )


def _between_periods(lines: ComplexArray) -> FloatArray:
    """Return the power by which the mean over the periods errs, from (realisations, periods, lines): (lines,)."""
    periods = lines.shape[1]
    if periods < 2:
        return np.zeros(lines.shape[2])
    off = lines - lines.mean(axis=1, keepdims=True)
    return np.asarray(np.sum(np.abs(off) ** 2, axis=(0, 1)) / (lines.shape[0] * (periods - 1.0) * periods))


def _silent_level(
    position: ComplexArray,
    command: ComplexArray,
    silent: Bins,
    spacing_hz: float,
    hertz: FloatArray,
    value: ComplexArray,
) -> FloatArray:
    """Return the root mean square of the position at silent lines beyond its noise, near each of `hertz`, (m,).

    What the response makes of a command that is not quite silent there is taken off.
    """
    if silent.size == 0:
        return np.full(hertz.size, np.nan)
    place: FloatArray = np.asarray(silent * spacing_hz, dtype=np.float64)
    turn = np.interp(place, hertz, np.unwrap(np.angle(value)))
    response = np.exp(np.interp(place, hertz, np.log(np.abs(value))) + 1j * turn)
    lines = position[:, :, silent] - response * command[:, :, silent]
    beyond = np.mean(np.abs(lines.mean(axis=1)) ** 2, axis=0) - _between_periods(lines)
    seen = np.abs(response) ** 2
    return np.sqrt(np.maximum(mean_over_frequency(beyond / seen, place, hertz, 0.5 * POOLED, _FEWEST), 0.0)) * np.abs(
        value
    )


def _repeats(command: ComplexArray, lines: Bins) -> bool | None:
    if command.shape[1] < 2:
        return None
    changing = float(np.sum(_between_periods(command)))
    return changing < _REPEATED * float(np.sum(np.mean(np.abs(command[:, :, lines]) ** 2, axis=(0, 1))))
