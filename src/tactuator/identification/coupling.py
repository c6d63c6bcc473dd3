"""The matrix of responses of several channels that were driven at once, from a joint record of periods.

At every excited line the settled periods give the spectra U and Y of all channels in all experiments, and G = Y U* (U
U*)^-1. What differs between periods is noise; what differs between experiments beyond it is distortion, which is told
where there are more experiments than channels, and by the odd lines left silent otherwise (Pintelon & Schoukens, System
Identification: A Frequency Domain Approach, 2012, sections 2.7 and 4.3). Any experiments will do that drive the
channels differently: orthogonal multisines, one channel after the other, random phases.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput
from tactuator.model.coupling import CoupledResponse
from tactuator.signals.multisine import Periods, periods_of
from tactuator.signals.record import JointRecord, Record

_POOLED, _FEWEST = 0.15, 8
_ALIKE = 1e3
"""Condition of the commands' matrix from which on the channels were driven too much alike to be told apart."""
_CHANCE = 0.01
"""Chance, over all lines and pairs together, of telling of a coupling where there is none."""


@dataclass(frozen=True)
class CoupledPair:
    """What a record says of the command of `driver` on the motion of `channel`.

    is_seen: whether any line shows a coupling. share_db: the greatest share that is seen (volts of the channel's own
    command per volt of the driver's), or, if none is seen, the least level above which there is none; at frequency_hz.
    confidence_db: 95 % half-width of a share that is seen.
    """

    channel: str
    driver: str
    is_seen: bool
    share_db: float
    confidence_db: float
    frequency_hz: float


def coupled_response(record: JointRecord) -> CoupledResponse:
    """Return the matrix of responses of a joint record, with its standard deviation.

    Raises BadInput for a record without a plan of periods, with fewer experiments than channels, or whose channels were
    not driven differently.
    """
    plan = _plan(record)
    sides = (record.command, record.position)
    command, position = (np.stack([_lines(plan, column) for column in side.T]) for side in sides)
    u, y = command[..., plan.lines].mean(axis=2), position[..., plan.lines].mean(axis=2)  # (channel, experiment, line)
    into, out = u.transpose(2, 0, 1), y.transpose(2, 0, 1)
    power = into @ into.conj().transpose(0, 2, 1)
    size = np.sqrt(np.einsum("mii->mi", power).real)
    if not np.all(size > 0.0) or np.max(np.linalg.cond(power / (size[:, :, None] * size[:, None, :]))) > _ALIKE:
        raise BadInput("the channels were driven alike, or not all of them", "experiments that tell them apart")
    inverse = np.linalg.inv(power)
    value = out @ into.conj().transpose(0, 2, 1) @ inverse
    each = _scatter(plan, value, command, position, record.rate_hz)
    deviation = np.sqrt(each[:, :, None] * np.einsum("mii->mi", inverse).real[:, None, :])
    hertz = np.asarray(plan.lines * (record.rate_hz / plan.period), dtype=np.float64)
    return CoupledResponse(record.channels, hertz, value.real, value.imag, deviation)


def _plan(record: JointRecord) -> Periods:
    plan = periods_of(record.about, record.command.shape[0])
    if plan is None:
        raise BadInput("a record of several channels without periods", "one that `record --together` made")
    if plan.realisations < len(record.channels) or plan.repeats < 3:
        got = f"{plan.realisations} experiments of {plan.repeats} periods"
        raise BadInput(got, f"{len(record.channels)} or more (one for each channel) of 3 or more")
    return plan


def _lines(plan: Periods, values: FloatArray) -> ComplexArray:
    """Return the spectra of the settled periods of a signal (n,): (experiments, periods, lines of half a period)."""
    return np.asarray(np.fft.rfft(plan.blocks(values), axis=2) / plan.period)


def _scatter(
    plan: Periods, value: ComplexArray, command: ComplexArray, position: ComplexArray, rate_hz: float
) -> FloatArray:
    """Return the power by which each channel's mean over the periods of one experiment errs at the lines, (m,
    channels): noise by what differs between periods; with the distortion by what differs between experiments, or by the
    silent odd lines where there are no more experiments than channels; the greater. Distortion has the plant's shape.
    """
    lines, count = plan.lines, len(command)
    hertz, spacing = lines * rate_hz / plan.period, rate_hz / plan.period
    off = position[..., lines] - np.einsum("mij,jepm->iepm", value, command[..., lines])
    moved = off - off.mean(axis=2, keepdims=True)
    periods = off.shape[2]
    noise = np.sum(np.abs(moved) ** 2, axis=(1, 2)) / (off.shape[1] * (periods - 1.0) * periods)
    silent, _ = plan.silent(rate_hz)
    rows = []
    for channel, between in enumerate(noise):
        size = np.abs(value[:, channel, channel]) ** 2 * np.mean(np.abs(command[channel][..., lines]) ** 2, axis=(0, 1))
        if plan.realisations > count:
            rest = np.sum(np.abs(off[channel].mean(axis=1)) ** 2, axis=0) / (plan.realisations - count)
            beyond = np.maximum(_near(hertz, hertz, rest / size), rest / size)  # friction's rises towards one end
        elif silent.size:
            heard = np.mean(np.abs(position[channel][..., silent].mean(axis=1)) ** 2, axis=0)
            place = np.asarray(silent * spacing)
            beyond = _near(hertz, place, heard / np.exp(np.interp(np.log(place), np.log(hertz), np.log(size))))
        else:
            beyond = np.zeros(hertz.size)
        rows.append(np.maximum(_near(hertz, hertz, between), beyond * size))
    return np.stack(rows, axis=1)


def _near(at_hz: FloatArray, place_hz: FloatArray, power: FloatArray) -> FloatArray:
    """Return the mean of powers at place_hz (n,) over 15 % of frequency, at least eight, around each of at_hz (m,)."""
    away = np.abs(np.log(place_hz[None, :] / at_hz[:, None]))
    fewest = min(_FEWEST, place_hz.size) - 1
    near = away <= np.maximum(0.5 * _POOLED, np.partition(away, fewest, axis=1)[:, fewest])[:, None]
    return np.asarray(np.sum(near * power, axis=1) / np.sum(near, axis=1))


def own_record(record: JointRecord, response: CoupledResponse, place: int) -> Record:
    """Return the record of one channel without what the others' commands move of it: for a model of its own."""
    plan, value = _plan(record), response.value
    moved, others = record.position[:, place].copy(), np.delete(np.arange(len(record.channels)), place)
    rising = np.clip(np.arange(plan.repeats * plan.period) / (0.5 * plan.period), 0.0, 1.0)
    rising = 0.5 - 0.5 * np.cos(np.pi * rising)  # what is still settling changes over from wave to wave
    before = np.zeros(rising.size)
    for begin in range(0, plan.samples, rising.size):
        settled = record.command[begin + plan.period : begin + rising.size]
        spectrum = np.fft.rfft(settled.reshape(plan.repeats - 1, plan.period, -1).mean(axis=0), axis=0)
        arrived = np.zeros(spectrum.shape[0], dtype=np.complex128)
        arrived[plan.lines] = np.sum(value[:, place, others] * spectrum[plan.lines][:, others], axis=1)
        wave = np.tile(np.fft.irfft(arrived, plan.period), plan.repeats)
        moved[begin : begin + rising.size] -= rising * wave + (1.0 - rising) * before
        before = wave
    return record.of(place, moved)


def coupled_pairs(response: CoupledResponse) -> tuple[CoupledPair, ...]:
    """Return what is known of every pair of channels: the coupling that is seen, or the level above which there is none
    (with 95 %, in the third octave that allows the most). A level is the root of the mean power of a third octave's
    shares, less what noise adds to it."""
    shares, deviation = response.shares()
    names, frequency_hz = response.channels, response.frequency_hz
    tests = frequency_hz.size * len(names) * (len(names) - 1)
    certain = np.sqrt(np.log(tests / _CHANCE))  # a complex normal number passes x deviations with exp(-x^2)
    near = np.abs(np.log2(frequency_hz[:, None] / frequency_hz)) <= 1.0 / 6.0
    pairs = []
    for out, of in permutations(range(len(names)), 2):
        size, unsure = np.abs(shares[:, out, of]), deviation[:, out, of]
        weight = near / unsure**2
        weight /= np.sum(weight, axis=1, keepdims=True)
        power = np.maximum(weight @ (size**2 - unsure**2), 0.0)
        spread = np.sqrt((weight**2) @ (unsure**2 * (2.0 * power + unsure**2)))
        seen = size > certain * unsure
        is_seen = bool(np.any(seen))
        place = int(np.argmax(np.where(seen, power - 2.0 * spread, -1.0) if is_seen else power + 2.0 * spread))
        level = power[place] if is_seen else power[place] + 2.0 * spread[place]
        half = 10.0 * np.log10(1.0 + 2.0 * spread[place] / power[place]) if is_seen else 0.0
        share_db, hertz = 10.0 * np.log10(level), frequency_hz[place]
        pairs.append(CoupledPair(names[out], names[of], is_seen, float(share_db), float(half), float(hertz)))
    return tuple(pairs)
