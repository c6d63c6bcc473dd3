"""Whether a mechanism stayed the same: what parts of the records say of the response, beside each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.check import moved_range
from tactuator.identification.data import HIGHEST_OF, Signals
from tactuator.identification.likelihood import SpectralFit
from tactuator.identification.lines import Spectrum, spectrum
from tactuator.identification.residual import choice_of_model
from tactuator.identification.residual_tests import NO_CHANGE, Change
from tactuator.identification.uncertainty import log_slopes, variances

_PARTS = 5
"""Parts of each record: what rests on a mechanism for a third of it fills one of them at least."""
_FEWEST, _POINTS = 200, 40
"""Samples of a part, from which on its noise is known; frequencies at which parts are compared."""
_STILL = 3e-3
"""Share of the command's deviation below which it moves nothing in a part."""
_BEYOND = 4.0
"""Deviations of a difference that chance may bring: of the greatest of many pairs, at many frequencies."""


def change_along(fit: SpectralFit, signals: Signals, spectra: Sequence[Spectrum]) -> Change:
    """Return how far the parts of the records depart from a fit to them all, each to first order, beside each other.

    A part speaks of the frequencies that its command moved. signals, spectra: of every record, as they were fitted.
    """
    if not signals:
        return NO_CHANGE
    hertz = np.geomspace(*moved_range(spectra), _POINTS)
    slopes, rows = log_slopes(fit, hertz), list[tuple[ComplexArray, FloatArray, NDArray[np.bool_]]]()
    places: list[tuple[int, int]] = []
    for place, part in _parts(signals, spectra):
        places.append(place)
        choice = choice_of_model(fit, [part], HIGHEST_OF[fit.grid.hold] * part.rate_hz)
        covariance, (low, high) = choice.problem.covariance_of(choice.fit), moved_range([part])
        variance = np.add(*variances(slopes, covariance))
        rows.append((slopes @ choice.problem.step_of(choice.fit), variance, (hertz >= low) & (hertz <= high)))
    if not rows:
        return NO_CHANGE
    moved, variance, known = (np.stack(column) for column in zip(*rows, strict=True))
    weight = known / np.maximum(variance, 1e-300)
    share = weight / np.maximum(weight.sum(axis=0), 1e-300)
    away = np.where(known, moved - (share * moved).sum(axis=0), 0.0)
    beyond = np.zeros(hertz.size)
    for one, other in combinations(range(len(rows)), 2):
        chance = _BEYOND * np.sqrt(variance[one] + variance[other])
        apart = np.abs((moved[one] - moved[other]).real) - chance
        beyond = np.maximum(beyond, np.where(known[one] & known[other], apart, 0.0))
    if not beyond.any():
        return NO_CHANGE
    by_chance, count = (variance * known).sum(axis=0), np.maximum(known.sum(axis=0), 1)
    real, imaginary = (
        np.sqrt(np.maximum((part**2).sum(axis=0) - by_chance, 0.0) / count) for part in (away.real, away.imag)
    )
    most = int(np.argmax(np.abs(away.real[:, np.argmax(beyond)])))
    return Change(hertz, real + 1j * imaginary, float(beyond.max()), places[most])


def _parts(signals: Signals, spectra: Sequence[Spectrum]) -> Iterator[tuple[tuple[int, int], Spectrum]]:
    for record, ((command, position), taken) in enumerate(zip(signals, spectra, strict=True)):
        count = min(_PARTS, taken.samples // _FEWEST)
        for begin, end in pairwise(np.linspace(0, taken.samples, count + 1).astype(int)):
            piece = slice(begin, end + taken.shift)
            if np.std(command[piece]) > _STILL * np.std(command):
                place = record, int(begin + end) // 2
                yield place, spectrum(command[piece], position[piece], taken.rate_hz, taken.shift)
