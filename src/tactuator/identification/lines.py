"""A record's lines, gathered in bands where there are many: a fit costs the same for a second and for an hour.

Within a narrow band response and transient are polynomials of second degree in frequency, so that an orthogonal
transformation turns all its lines into six equations and one number, the power that no such polynomial explains. The
same three coefficients, fitted band by band, are the local polynomial estimate of the response (Pintelon and Schoukens,
2012, chapter 7).

The equations of several records of one mechanism follow one another, each with its own transient, ends and
noise. The noise's power, from what a model leaves of the record, weighs the lines. Weighted by its own residual's
spectrum the estimate is consistent in closed loop too, as long as all lines up to half the rate take part: what the
loop feeds back of the noise is causal, so that its sum over the whole circle vanishes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.hold import Grid, edge_columns
from tactuator.signals.spectra import mean_over_frequency

HIGHEST = 0.47
"""Highest line that is looked at, over the sampling rate: what lies above is the flank of an anti-alias filter."""
POOLED = 0.15
"""Width of a mean over frequency, over the frequency: narrow beside a response's bends, wide beside its noise."""
NODES = 3
"""Nodes of a band: they carry a polynomial of second degree."""
_PLACES = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)[::-1]
_FEWEST = 9
"""Lines below which a band is kept line by line."""
_WIDEST = 1.0 / 1200.0
"""Widest band over the sampling rate: a dead time of 150 samples turns the phase by less than a radian in it."""
_WIDEST_TURNED_BACK = 1.0 / 150.0
"""The same where the dead time is taken off beforehand."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Lines of command and position over the square root of the number of samples, zero first; position shifted."""

    command: ComplexArray
    position: ComplexArray
    rate_hz: float
    samples: int
    shift: int = 0

    @property
    def spacing_hz(self) -> float:
        """Return the distance between lines."""
        return self.rate_hz / self.samples

    @cached_property
    def frequency_hz(self) -> FloatArray:
        """Return the frequencies of the lines."""
        return np.asarray(np.arange(self.command.size) * self.spacing_hz)

    @cached_property
    def grid(self) -> Grid:
        """Return all lines but zero, of the record as if its position were not shifted."""
        return _all_lines(self.samples, self.rate_hz)

    @cached_property
    def ahead(self) -> ComplexArray:
        """Return what the position's shift does to the lines but zero, (m - 1,)."""
        return np.asarray(np.exp(2j * np.pi * self.frequency_hz[1:] * self.shift / self.rate_hz))

    @cached_property
    def measured(self) -> FloatArray:
        """Return the position's samples, shifted and without mean, (n,)."""
        return self.samples_of(np.concatenate([[0.0], self.position[1:]]))

    def samples_of(self, lines: ComplexArray) -> FloatArray:
        """Return the samples (n,) of lines as those of the record are."""
        return np.asarray(np.fft.irfft(lines, self.samples) * np.sqrt(self.samples))

    def under(self, command: FloatArray) -> Spectrum:
        """Return the same position's lines under another command (n,); what does not depend on it is not done again."""
        other = copy(self)
        (other.__dict__["command"],) = _lines_of(command[: self.samples])
        return other


@lru_cache(maxsize=1)
def _all_lines(samples: int, rate_hz: float) -> Grid:
    """Return the lines but zero of a record: they are those of its next estimate, too."""
    return Grid(np.arange(1.0, samples // 2 + 1) * (rate_hz / samples), rate_hz, rate_hz, "zero-order")


def spectrum(command: FloatArray, position: FloatArray, rate_hz: float, shift: int = 0) -> Spectrum:
    """Return the lines of a record (n,) whose position is read `shift` samples later, means taken off.

    Of a long record the last few samples may be left out.
    """
    count = command.size - shift
    # samples from which on a few are left out for a length without large prime factors (0.1 % at most)
    if count > 20_000:
        # a length with a large prime factor takes the transform many times as long
        count = scipy.fft.prev_fast_len(count, real=True)
    early, late = _lines_of(command[:count], position[shift : shift + count])
    return Spectrum(early, late, rate_hz, count, shift)


def _lines_of(*rows: FloatArray) -> list[ComplexArray]:
    return [lines / np.sqrt(rows[0].size) for lines in np.fft.rfft([row - row.mean() for row in rows])]


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations goal = response_of(G) + transient_of(T) + noise, one complex equation each; power of noise as in single
    lines.

    frequency_hz: where G and T are wanted, (m,): `raw` single lines, then NODES for each of b bands. rest: power (b,)
    that the bands' equations leave, of lines - 2 NODES lines. of_hz: frequency of each equation. shift: as in Spectrum.
    """

    frequency_hz: FloatArray
    raw: int
    command: ComplexArray
    position: ComplexArray
    by_response: ComplexArray
    by_transient: ComplexArray
    by_goal: ComplexArray
    rest: FloatArray
    lines: FloatArray
    centre_hz: FloatArray
    rate_hz: float
    shift: int

    @property
    def parts(self) -> tuple[Equations, ...]:
        """Return the equations of each record: of this one alone."""
        return (self,)

    @cached_property
    def goal(self) -> ComplexArray:
        """Return the left side, (e,)."""
        return np.concatenate([self.position, self.by_goal.reshape(-1)])

    @cached_property
    def of_hz(self) -> FloatArray:
        """Return the frequency of each equation, (e,)."""
        return np.concatenate([self.frequency_hz[: self.raw], np.repeat(self.centre_hz, 2 * NODES)])

    @property
    def spare(self) -> FloatArray:
        """Return the lines of each band beyond its equations, (b,)."""
        return np.maximum(self.lines - 2 * NODES, 0.0)

    @property
    def total(self) -> int:
        """Return the number of real equations that the record gives."""
        return int(2 * (self.goal.size + self.spare.sum()))

    def response_of(self, values: ComplexArray) -> ComplexArray:
        """Return the equations' right sides for responses (m, c) at the nodes: (e, c)."""
        return self._gathered(values[: self.raw].T * self.command, self.by_response, values)

    def transient_of(self, values: ComplexArray, *, ends: bool = False) -> ComplexArray:
        """Return the same for transients (m, c); ends: and for what the record's ends may add, (e, c + k)."""
        columns = self._gathered(values[: self.raw].T, self.by_transient, values)
        return np.hstack([columns, self.ends]) if ends else columns

    @cached_property
    def ends(self) -> ComplexArray:
        """Return the right sides of what the record's ends may add, (e, k)."""
        return self.transient_of(edge_columns(Grid(self.frequency_hz, self.rate_hz, 1.0, "band-limited")))

    def _gathered(self, top: ComplexArray, operator: ComplexArray, values: ComplexArray) -> ComplexArray:
        """Return right sides (e, c), column by column in memory: they are wanted so, and long rows take less time."""
        if not self.lines.size:
            return top.T
        width = values.shape[1]
        low = np.ascontiguousarray(values[self.raw :].reshape(-1, NODES, width).T)[:, :, None]
        # three sums of whole arrays take a third of the time of many small products of matrices
        sums = operator[0] * low[:, 0]
        for k in range(1, NODES):
            sums += operator[k] * low[:, k]
        return np.concatenate([top, sums.transpose(0, 2, 1).reshape(width, -1)], axis=1).T


def points(frequency_hz: FloatArray, response: ComplexArray, rate_hz: float) -> Equations:
    """Return equations of a response by itself, (m,): command 1, no bands."""
    none = np.zeros((NODES, 2 * NODES, 0), dtype=np.complex128)
    ones = np.ones(frequency_hz.size, dtype=np.complex128)
    empty = np.zeros(0)
    return Equations(
        frequency_hz, frequency_hz.size, ones, response, none, none, none[0].T, empty, empty, empty, rate_hz, 0
    )


@lru_cache(maxsize=4)  # a record's next estimate asks for them
def band_edges(
    samples: int, first: int, last: int, share: float, fewest: int, widest: float = _WIDEST
) -> list[tuple[int, int]]:
    """Return (begin, end) of bands over lines first .. last - 1, `share` of their frequency wide, `fewest` lines."""
    bands, k = [], first
    while k < last:
        width = max(fewest, int(min(share * k, widest * samples)))
        end = min(k + width, last)
        bands.append((k, last if last - end < fewest else end))
        k = bands[-1][1]
    return bands


def equations(taken: Spectrum) -> Equations:
    """Return the equations of the lines below half the rate, in bands a hundredth of their frequency wide."""
    last = min(int(np.floor(0.5 * taken.rate_hz / taken.spacing_hz + 1e-9)) + 1, (taken.samples + 1) // 2)
    singles: list[tuple[int, int]] = []
    bands: list[tuple[int, int]] = []
    for begin, end in band_edges(taken.samples, 1, last, 0.01, _FEWEST, _WIDEST_TURNED_BACK):
        (bands if end - begin > _FEWEST + NODES else singles).append((begin, end))
    kept = np.concatenate([np.arange(*single) for single in singles] or [np.zeros(0, dtype=np.int64)])
    triangle, ends = _triangles(taken, bands, _lagrange), np.array(bands, dtype=np.float64).reshape(-1, 2)
    top = triangle[:, : 2 * NODES]
    by_response, by_transient, by_goal = top[:, :, :NODES].T, top[:, :, NODES:-1].T, top[:, :, -1]
    rest, lines = np.abs(triangle[:, -1, -1]) ** 2, ends[:, 1] - ends[:, 0]
    middle, half = 0.5 * (ends[:, 0] + ends[:, 1] - 1.0), 0.5 * (lines - 1.0)
    nodes = (middle[:, None] + half[:, None] * _PLACES) * taken.spacing_hz
    frequency = np.concatenate([kept * taken.spacing_hz, nodes.ravel()])
    centre = nodes[:, NODES // 2].copy()
    return Equations(
        frequency, kept.size, taken.command[kept], taken.position[kept], np.ascontiguousarray(by_response),
        np.ascontiguousarray(by_transient), by_goal, rest, lines, centre, taken.rate_hz, taken.shift,
    )  # fmt: skip


def _lagrange(place: FloatArray) -> FloatArray:
    """Return the polynomials that are one at one node and zero at the others over -1 .. 1 (b, l), (b, NODES, l)."""
    basis = np.ones((place.shape[0], NODES, place.shape[1]))
    for a in range(NODES):
        for b in range(NODES):
            if a != b:
                basis[:, a] *= (place - _PLACES[b]) / (_PLACES[a] - _PLACES[b])
    return basis


@dataclass(frozen=True, eq=False)
class LocalResponse:
    """The response as the record shows it by itself: frequency_hz, value, variance (of its complex error), noise (power
    of a position's line that is not the command's), excitation (power of a command's line), lines; all (m,)."""

    frequency_hz: FloatArray
    value: ComplexArray
    variance: FloatArray
    noise: FloatArray
    excitation: FloatArray
    lines: FloatArray

    @property
    def blindness(self) -> FloatArray:
        """Return the variance over that of a response of which one line has all the command's power, (m,)."""
        return np.asarray(self.variance / self.noise * self.excitation * self.lines)

    @property
    def weight(self) -> FloatArray:
        """Return one over the deviation of each value, none taken for surer than the curvature within its band."""
        # relative error of a point that is not believed to be smaller: curvature within its band
        return np.asarray(1.0 / np.sqrt(self.variance + (3e-3 * np.abs(self.value)) ** 2))

    def at(self, keep: NDArray[np.bool_]) -> LocalResponse:
        """Return the points where `keep` (m,)."""
        return LocalResponse(*(getattr(self, item.name)[keep] for item in fields(self)))


_NEARLY, _ROUNDS = 10.0, 6
"""Variance amid a band over the least in it, up to which the middle is taken; steps towards the least."""


def local_response(taken: Spectrum, high_hz: float) -> LocalResponse:
    """Return the local polynomial estimate in bands 2 % of their frequency wide, at least 13 lines, of each where it is
    surest: where a band has one sine, the response is known at that sine alone. The position's shift is put back.
    """
    last = min(int(high_hz / taken.spacing_hz) + 1, (taken.samples + 1) // 2)
    bands = [band for band in band_edges(taken.samples, 2, last, 0.02, 13) if band[1] - band[0] >= 2 * NODES + 2]
    triangle = _triangles(taken, bands, _powers)
    size = np.abs(np.diagonal(triangle[:, :-1, :-1], axis1=1, axis2=2))
    least, most = size.min(axis=1, initial=np.inf), size.max(axis=1, initial=0.0)
    seen = (size[:, :NODES].min(axis=1, initial=np.inf) > 1e-9 * most) & (least > 1e-13 * most)
    triangle, ends = triangle[seen], np.array(bands, dtype=np.int64).reshape(-1, 2)[seen]
    lines = (ends[:, 1] - ends[:, 0]).astype(np.float64)
    total = np.add.reduceat(np.abs(taken.command) ** 2, ends.ravel())[::2]
    place, first = _surest(np.linalg.inv(triangle[:, :-1, :-1])[:, :NODES], lines / (lines - 1.0))
    spread = np.sum(np.abs(first) ** 2, axis=1)
    noise = np.maximum(np.abs(triangle[:, -1, -1]) ** 2 / (lines - 2 * NODES), 1e-200)
    frequency = (0.5 * (ends[:, 0] + ends[:, 1] - 1) + 0.5 * place * (lines - 1.0)) * taken.spacing_hz
    late = np.exp(-2j * np.pi * frequency * taken.shift / taken.rate_hz)
    value = np.sum(first * triangle[:, :-1, -1], axis=1) * late
    return LocalResponse(frequency, value, noise * spread, noise, total / lines, lines)


def _surest(rows: ComplexArray, far: FloatArray) -> tuple[FloatArray, ComplexArray]:
    """Return where in each band, as `far` (b,) from its middle as the next band begins, the response has the least
    variance, (b,), and what of the band's triangle it is there, (b, 2 NODES), from that of its coefficients (b, NODES,
    2 NODES): the middle, if that is nearly as sure.
    """

    def at(place: FloatArray) -> ComplexArray:
        return np.asarray(rows[:, 0] + place[:, None] * (rows[:, 1] + place[:, None] * rows[:, 2]))

    def variance(place: FloatArray) -> FloatArray:
        return np.asarray(np.sum(np.abs(at(place)) ** 2, axis=1))

    middle = np.zeros(rows.shape[0])
    tried = np.linspace(-1.0, 1.0, 21)
    place = far * tried[np.argmin([variance(far * x) for x in tried], axis=0)]
    for _ in range(_ROUNDS):
        slope = rows[:, 1] + 2.0 * place[:, None] * rows[:, 2]
        step = np.sum((slope.conj() * at(place)).real, axis=1) / np.sum(np.abs(slope) ** 2, axis=1)
        place = np.clip(place - step, -far, far)
    place = np.where(_NEARLY * variance(place) < variance(middle), place, middle)
    return place, at(place)


_AT_ONCE = 1 << 14
"""Lines of bands that are worked on together."""
_KEPT = 1 << 17
"""Most lines of a record whose polynomials are kept: they take 33 bytes a line."""
_ALIKE = 1.1
"""Widest of them over the narrowest, which comes first."""


def _powers(place: FloatArray) -> FloatArray:
    """Return the polynomials 1, x, x^2 over -1 .. 1 (b, l), (b, NODES, l)."""
    return np.stack([np.ones_like(place), place, place * place], axis=1)


def _triangles(
    taken: Spectrum, bands: Sequence[tuple[int, int]], shape_of: Callable[[FloatArray], FloatArray]
) -> ComplexArray:
    """Return the triangle of each band's columns, (b, 2 NODES + 1, 2 NODES + 1): command and a transient, each with
    polynomials of second degree, and the position. What lies beyond the columns' triangle is the position's share of
    them, and what they leave of it.
    """
    triangles = np.empty((len(bands), 2 * NODES + 1, 2 * NODES + 1), dtype=np.complex128)
    alike = _kept_alike if taken.command.size <= _KEPT else _alike
    for piece, inside, shape, lines in alike(tuple(bands), taken.command.size - 1, shape_of):
        columns = np.empty((lines.shape[0], 2 * NODES + 1, lines.shape[1]), dtype=np.complex128)
        np.multiply(taken.command[lines][:, None], shape, out=columns[:, :NODES])
        columns[:, NODES:-1] = shape
        columns[:, -1] = np.where(inside, taken.position[lines], 0.0)
        triangles[piece] = np.linalg.qr(columns.transpose(0, 2, 1), mode="r")
    return triangles


_Alike = tuple[slice, NDArray[np.bool_], FloatArray, NDArray[np.int64]]


def _alike(
    bands: tuple[tuple[int, int], ...], last: int, shape_of: Callable[[FloatArray], FloatArray]
) -> Iterator[_Alike]:
    """Yield bands of nearly one width together: which, where each has lines, the polynomials and the lines; narrower
    ones are filled up with zeros, which change no triangle.
    """
    edges, done = np.array(bands, dtype=np.int64).reshape(-1, 2), 0
    widths = np.diff(edges, axis=1)[:, 0]
    while done < len(bands):
        some = widths[done : done + max(_AT_ONCE // int(widths[done]), 1)]
        alike = np.flatnonzero((some > _ALIKE * some[0]) | (some < some[0]))
        piece = slice(done, done + (int(alike[0]) if alike.size else some.size))
        width = widths[piece, None].astype(np.float64)
        place = np.arange(int(width.max()))
        inside = place < width
        shape = np.where(inside[:, None], shape_of((place - 0.5 * (width - 1.0)) / (0.5 * (width - 1.0))), 0.0)
        yield piece, inside, shape, np.minimum(edges[piece, :1] + place, last)
        done = piece.stop


@lru_cache(maxsize=2)
def _kept_alike(*of: Any) -> tuple[_Alike, ...]:
    """Return the same: a record's next estimate asks for it."""
    return tuple(_alike(*of))


@dataclass(frozen=True, eq=False)
class JoinedEquations:
    """The equations of several records one after the other; attributes and methods as `Equations` has them."""

    parts: tuple[Equations, ...]

    @cached_property
    def frequency_hz(self) -> FloatArray:
        """Return where responses are wanted, (m,): each part's frequencies in turn."""
        return np.concatenate([part.frequency_hz for part in self.parts])

    @cached_property
    def goal(self) -> ComplexArray:
        """Return the left sides, (e,)."""
        return np.concatenate([part.goal for part in self.parts])

    @cached_property
    def of_hz(self) -> FloatArray:
        """Return the frequency of each equation, (e,)."""
        return np.concatenate([part.of_hz for part in self.parts])

    @property
    def rate_hz(self) -> float:
        """Return the sampling rate, the same for all."""
        return self.parts[0].rate_hz

    @property
    def shift(self) -> int:
        """Return by how many samples the positions are read later, the same for all."""
        return self.parts[0].shift

    @property
    def total(self) -> int:
        """Return the number of real equations that the records give."""
        return sum(part.total for part in self.parts)

    def response_of(self, values: NDArray[Any]) -> ComplexArray:
        """Return the equations' right sides for responses (m, c): (e, c)."""
        return np.concatenate(
            [part.response_of(values[piece]) for part, piece in zip(self.parts, self._pieces, strict=True)]
        )

    def transient_of(self, values: NDArray[Any], *, ends: bool = False) -> ComplexArray:
        """Return the right sides for transients (m, c), each record with its own weights: (e, c * records)."""
        pairs = zip(self.parts, self._pieces, strict=True)
        return np.asarray(scipy.linalg.block_diag(*(part.transient_of(values[at], ends=ends) for part, at in pairs)))

    @cached_property
    def _pieces(self) -> list[slice]:
        return slices([part.frequency_hz.size for part in self.parts])


def slices(sizes: Sequence[int]) -> list[slice]:
    """Return the places of pieces of those sizes, one after the other."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(begin, end) for begin, end in pairwise(ends)]


def equation_slices(given: Equations | JoinedEquations) -> list[slice]:
    """Return the equations of each record among all of them."""
    return slices([part.goal.size for part in given.parts])


def equations_of(spectra: Iterable[Spectrum]) -> Equations | JoinedEquations:
    """Return the equations of all records; of one alone its own."""
    parts = tuple(equations(taken) for taken in spectra)
    return parts[0] if len(parts) == 1 else JoinedEquations(parts)


def join_local(parts: Sequence[LocalResponse]) -> LocalResponse:
    """Return the points of all records by frequency."""
    if len(parts) == 1:
        return parts[0]
    order = np.argsort(np.concatenate([part.frequency_hz for part in parts]), kind="stable")
    return LocalResponse(
        *(np.concatenate([getattr(part, item.name) for part in parts])[order] for item in fields(LocalResponse))
    )


_WIDTH, _FEWEST_AVERAGED = 0.12, 40
"""Width of the mean over the frequency, and lines in it at least: the power is known to 16 %."""


def _noise_power(
    given: Equations, residual: ComplexArray, shape: Callable[[FloatArray], FloatArray], fewest: int
) -> FloatArray:
    """Return the residual's mean power at each equation (e,), over 12 % of frequency, `fewest` lines, where it has the
    shape of a power (of frequencies in hertz) times one that hardly changes over such a band.
    """
    frequency = np.concatenate([given.of_hz, given.centre_hz])
    power = np.concatenate([np.abs(residual) ** 2, given.rest]) / shape(frequency)
    count = np.concatenate([np.ones(given.of_hz.size), given.spare])
    order = np.argsort(frequency, kind="stable")
    place = frequency[order]
    rows = np.stack([power[order], count[order]])
    mean = mean_over_frequency(rows, place, given.of_hz, 0.5 * _WIDTH, fewest)
    return np.asarray(np.maximum(mean[0] / mean[1] * shape(given.of_hz), 1e-30))


def weights(
    given: Equations | JoinedEquations,
    residual: ComplexArray,
    highest_hz: float,
    shape: Callable[[FloatArray], FloatArray] = np.ones_like,
    fewest: int = _FEWEST_AVERAGED,
) -> FloatArray:
    """Return one over each record's noise's deviation at each equation up to highest_hz, zero beyond, (e,).

    shape: what a disturbance at the mechanism's input makes of its power, up to a factor; it is taken where it makes
    the residual more likely than noise without it. fewest: lines in a mean, at least.
    """
    used = given.of_hz <= highest_hz
    pieces = zip(given.parts, equation_slices(given), strict=True)
    by_equation = np.concatenate(
        [
            min(
                (_noise_power(part, residual[piece], of, fewest) for of in (np.ones_like, shape)),
                key=lambda power: float(np.sum((np.log(power) + np.abs(residual[piece]) ** 2 / power)[used[piece]])),
            )
            for part, piece in pieces
        ]
    )
    return np.where(used, 1.0 / np.sqrt(by_equation), 0.0)
