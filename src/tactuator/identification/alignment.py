"""Are command and position aligned from the record's beginning to its end? Misalignment is reported, not repaired.

Pieces of the record are compared with the pieces before them: the impulse response that each shows by itself comes
later or earlier there where samples are lost in one column, and later by the same from piece to piece where the two
columns have different clocks. Where a piece says nothing about the others, as in a chirp, only the residual of a fit
shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput, within
from tactuator.signals.record import Record

_PIECES, _LONGEST, _SHORTEST = 12, 10_000, 200
"""Pieces of a record, and the most and the least samples of one."""
_ALIKE = 0.8
"""Correlation of the impulse responses of two pieces from which on their delay is known."""
_SEEN, _BEST = 0.25, 0.5
"""The same from which on a loss between them is looked for, and which the best of neighbouring ones must have."""
_DEVIATIONS, _LEAST_PPM = 6.0, 1.0
"""Deviations of a delay from which on it is none by chance; least difference of clocks that is reported, ppm."""
_FEW, _CLEARLY, _HARDLY = 8, 0.5, 0.9
"""Samples below which a loss hardly changes the response; and what its own delay leaves over what the other leaves,
below which a longer one is seen, and one of few samples.
"""


@dataclass(frozen=True)
class LostBlock:
    """Samples lost at one place. sample: of the position, as it was recorded; lost: of the position, or of the command
    where negative.
    """

    sample: int
    lost: int


def pieces_delays(command: FloatArray, *positions: FloatArray) -> tuple[int, FloatArray, FloatArray]:
    """Return the samples of half a piece, and by each position (n,), of each piece against that before it (two halves
    earlier), how much later its response comes, samples, and how alike the two are, (positions, k).
    """
    length = min(command.size // _PIECES, _LONGEST)
    half, count = length // 2, len(positions)
    if length < _SHORTEST:
        return half, np.zeros((count, 0)), np.zeros((count, 0))
    size, window = scipy.fft.next_fast_len(2 * length, real=True), np.hanning(length)
    before: list[tuple[ComplexArray, FloatArray]] = []
    later, alike = [], []
    for begin in range(0, command.size - length + 1, half):
        rows = [values[begin : begin + length] for values in (command, *positions)]
        lines = np.fft.rfft([window * (row - row.mean()) for row in rows], size)
        power = np.abs(lines[0]) ** 2
        response = np.conj(lines[0]) * lines[1:] / np.maximum(power + 0.1 * float(np.mean(power)), 1e-300)
        energy = np.sum(np.abs(response) ** 2, axis=1)
        if len(before) > 1:
            other, energy_before = before[-2]
            shared = np.fft.irfft(response * np.conj(other), size)
            near = np.concatenate([shared[:, -half:], shared[:, : half + 1]], axis=1)
            at = np.clip(np.argmax(near, axis=1), 1, near.shape[1] - 2)
            low, top, high = (near[range(count), at + step] for step in (-1, 0, 1))
            later.append(at - half + 0.5 * (low - high) / np.minimum(low - 2.0 * top + high, -1e-300))
            alike.append(top * 0.5 * size / np.maximum(np.sqrt(energy * energy_before), 1e-300))
        before.append((response, energy))
    return half, np.array(later).T, np.array(alike).T


def clocks_apart_ppm(half: int, later: FloatArray, alike: FloatArray) -> float:
    """Return by how many millionths the position's clock is slower than the command's, 0 where that is not certain."""
    kept = later[alike > _ALIKE]
    if kept.size < 6:
        return 0.0
    middle = float(np.median(kept))
    spread = max(1.4826 * float(np.median(np.abs(kept - middle))), 1e-4)
    # pieces overlap by half: about half of them are independent
    certain = abs(middle) > _DEVIATIONS * spread * 1.25 / np.sqrt(0.5 * kept.size)
    ppm = -1e6 * middle / (2.0 * half)
    return ppm if certain and abs(ppm) > _LEAST_PPM else 0.0


_FLAT, _AROUND, _OF_LEAST, _OF_USUAL = 1e-3, 21, 200.0, 0.03
"""Size of a step over the greatest of so many around it, below which it is none; that one over the least step there is,
and over their rms, from which on this is visible."""
_SEEN_FLAT, _AT_READ = 0.05, 0.99
"""Share of steps that are none, where samples were filled up; power of the steps at the others."""


def read_at(record: Record) -> slice:
    """Return which of the position's samples were read: all, or every so-manyth where the others repeat those before
    them, or lie straight between them, as where a slower logger's were filled up. Codes of a converter do so anywhere.
    """
    read, moved = slice(0, None, 1), np.flatnonzero(np.diff(record.command))
    for order in (1, 2) if moved.size and record.position.size > _AROUND else ():
        step = np.abs(np.diff(record.position, order))
        step[step < 1e-13 * float(np.max(np.abs(record.position)))] = 0.0
        around = _greatest(np.pad(step, _AROUND // 2, mode="edge"), _AROUND)
        least = float(np.min(step[step > 0.0], initial=np.inf))
        seen = around > max(_OF_LEAST * least, _OF_USUAL * float(np.sqrt(np.mean(step**2))))
        flat = seen & (step <= np.maximum(_FLAT * around, 3.0 * least))
        places = np.flatnonzero(seen & ~flat) + 1
        if places.size < 2 or float(np.mean(flat)) < _SEEN_FLAT:
            continue
        many = int(np.median(np.diff(places)))
        power, at_steps = np.bincount(places % many, step[places - 1] ** 2), np.bincount(moved % many)
        # what integrates runs straight itself between the steps of a command
        is_own = order == 2 and float(at_steps.max()) > _AT_READ * moved.size
        if many > 1 and float(power.max()) > _AT_READ * float(power.sum()) and not is_own:
            read = slice(int(np.argmax(power)), None, many)
    return read


def _greatest(values: FloatArray, count: int) -> FloatArray:
    """Return the greatest of each `count` values (n,) in a row, (n + 1 - count,), by rows of twice the length each."""
    width = 1
    while width < count:
        further = min(width, count - width)
        values, width = np.maximum(values[:-further], values[further:]), width + further
    return values


_REPEATS, _CODES = 0.2, 2.5
"""Share of a command's values that it repeats, from which on they are looked at; their usual change over the least,
below which they are codes of a converter or of a binary sequence."""


def moved_between(command: FloatArray) -> FloatArray | None:
    """Return a command (n,) as it was if it was logged more slowly than the position: gone on smoothly between the
    values that it repeats. None for one that repeats none, or that has few codes.
    """
    places = np.concatenate([[0], np.flatnonzero(np.diff(command)) + 1])
    if places.size < _AROUND or np.mean(np.diff(places) > 1) < _REPEATS:
        return None
    values = command[places]
    change = np.abs(np.diff(values))
    if np.median(change) < _CODES * np.min(change):
        return None
    along = np.minimum(np.arange(command.size), places[-1])
    return np.asarray(scipy.interpolate.CubicSpline(places, values)(along))


def losses(command: FloatArray, position: FloatArray) -> tuple[LostBlock, ...]:
    """Return what was lost of command or position (n,), in order; nothing where their clocks are apart."""
    position, (half, later, alike) = _clearest(command, position)
    spread = _scatter(later, alike)
    if not np.isfinite(spread) or clocks_apart_ppm(half, later, alike):
        return ()
    # least change of the delay, samples, that is taken for a lost one
    least = max(0.6, _DEVIATIONS * spread)
    jumps = (np.abs(later) > least) & (alike > _SEEN)
    blocks: list[LostBlock] = []
    for run in _runs(jumps):
        best = max(run, key=lambda k: float(alike[k]))
        lost = -round(float(later[best]))
        if lost and alike[best] > (_ALIKE if abs(lost) < _FEW else _BEST):
            # piece best + 2 begins where the one before it, two halves earlier, ends
            block = _placed(command, position, lost, sum(loss.lost for loss in blocks), (best, best + 4), half)
            blocks += [block] if block is not None else []
    return tuple(blocks)


def _clearest(command: FloatArray, position: FloatArray) -> tuple[FloatArray, tuple[int, FloatArray, FloatArray]]:
    """Return the position or the speed, (n,), whichever has the delays that scatter less, with `pieces_delays` of it:
    slow motion of friction or drift hides a delay in the position, and noise of the sensor in the speed.
    """
    either = (position, np.diff(position, prepend=position[:1]))
    half, *delays = pieces_delays(command, *either)
    scattered = [(_scatter(*of), each, of) for each, *of in zip(either, *delays, strict=True)]
    _, clearest, (later, alike) = min(scattered, key=lambda each: each[0])
    return clearest, (half, later, alike)


def _scatter(later: FloatArray, alike: FloatArray) -> float:
    """Return the standard deviation of the pieces' delays, samples; infinite where most are not known."""
    kept = later[alike > _ALIKE]
    if kept.size < max(6, 0.5 * later.size):
        return np.inf
    return max(1.4826 * float(np.median(np.abs(kept - np.median(kept)))), 1e-3)


def _runs(marked: np.ndarray) -> list[range]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(np.int8), [0]])))
    return [range(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]


def _placed(
    command: FloatArray, position: FloatArray, lost: int, before: int, halves: tuple[int, int], half: int
) -> LostBlock | None:
    """Return the loss at the sample where one delay explains the position up to it and the other from it on, None where
    neither does much better than the other; before: samples lost earlier.
    """
    begin, end = halves[0] * half, min(halves[1] * half, position.size)
    response = _impulse(command, position, before, max(begin - 6 * half, 0), max(begin, 4 * half))
    moved = np.asarray(scipy.signal.oaconvolve(command, response))

    def missed(late: int) -> FloatArray:
        place = np.clip(np.arange(begin, end) + late + response.size // 8, 0, command.size - 1)
        off = position[begin:end] - moved[place]
        return np.asarray((off - off.mean()) ** 2)

    early, late = missed(before), missed(before + lost)
    at = int(np.argmin(np.cumsum(early - late))) + 1
    most = _HARDLY if abs(lost) < _FEW else _CLEARLY
    is_clear = early[:at].sum() < most * late[:at].sum() and late[at:].sum() < most * early[at:].sum()
    return LostBlock(begin + at, lost) if is_clear else None


def _impulse(command: FloatArray, position: FloatArray, late: int, begin: int, end: int) -> FloatArray:
    """Return the response to an impulse that a stretch of the record shows, an eighth of it before time zero."""
    low = max(begin, -late, 0)
    high = min(end, position.size, command.size - max(late, 0))
    into, out = command[low + late : high + late], position[low:high]
    window = np.hanning(out.size)
    size = scipy.fft.next_fast_len(2 * out.size, real=True)
    lines = [np.fft.rfft(window * (row - row.mean()), size) for row in (into, out)]
    power = np.abs(lines[0]) ** 2
    response = np.fft.irfft(
        np.conj(lines[0]) * lines[1] / np.maximum(power + 0.01 * float(np.mean(power)), 1e-300), size
    )
    length = min(out.size // 4, 4096)
    return np.concatenate([response[-(length // 8) :], response[: length - length // 8]])


_BESIDE, _LEAST_PART = 0.003, 0.1
"""Shares of a record: what is left out before a loss, and what has to lie before it to be of use."""


LONGEST = 1_000_000
"""Samples identified at once, of all records together (0.8 GB); of longer ones the part with most command power."""


def align(records: Sequence[Record]) -> tuple[list[Record], list[str]]:
    """Return the part of each record that is used, and what is to be reported of them. Raises BadInput for a record
    whose columns do not run together.
    """
    parts, remarks = list[Record](), list[str]()
    for k, record in enumerate(records):
        where = () if len(records) == 1 else (f"record {k + 1}",)
        part, shortened = _liveliest(record, LONGEST // len(records))
        with within(*where):
            require_aligned(part)
        parts.append(part)
        remarks += [": ".join([*where, remark]) for remark in [*record.remarks, *shortened]]
    return parts, remarks


def _liveliest(record: Record, most: int) -> tuple[Record, tuple[str, ...]]:
    """Return the part, of `most` samples, in which the command has most power, and what is to be said of that."""
    count, rate_hz = record.command.size, record.rate_hz
    if count <= most:
        return record, ()
    power = np.cumsum((record.command - record.command.mean()) ** 2)
    starts = np.arange(0, count - most + 1, most // 4)
    best = int(starts[np.argmax(power[starts + most - 1] - power[starts])])
    said = f"of {record.duration_s:.4g} s the {most / rate_hz:.4g} s from {best / rate_hz:.4g} s are used"
    return record.between(best / rate_hz, (best + most) / rate_hz), (said,)


def require_aligned(record: Record) -> None:
    """Refuse a record whose columns do not run together: samples lost in one of them, or filled up between those that
    were read.
    """
    read = read_at(record)
    if read.step > 1:
        raise BadInput(
            f"of every {read.step} samples of the position one was read, the others were filled up between them",
            "both columns recorded at one rate",
        )
    blocks = losses(record.command, record.position)
    if blocks:
        places = [record.from_s + block.sample / record.rate_hz for block in blocks]
        lost = [
            f"about {abs(block.lost)} of the {'position' if block.lost > 0 else 'command'} at {place:.6g} s"
            for block, place in zip(blocks, places, strict=True)
        ]
        before = places[0] - max(_BESIDE * record.duration_s, 16.0 / record.rate_hz)
        is_use = before - record.from_s > _LEAST_PART * record.duration_s
        raise BadInput(
            f"samples are missing: {', '.join(lost)}",
            f"what lies before (`to_s` {before:.4g})" if is_use else "a record without gaps",
        )


def clock_skew_ppm(record: Record) -> float:
    """Return by how many millionths the clocks of the columns are apart, 0 where pieces of the record do not show
    it.
    """
    return abs(clocks_apart_ppm(*_clearest(record.command, record.position)[1]))
