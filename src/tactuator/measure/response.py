"""The response of a display at a level: frequency by frequency (stepped sine), or all at once (multisine)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import ArrayLike

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.measure.lines import SETTLE_S, Lines, Periodic, Tone, Watch, measure_lines, reference_on
from tactuator.measure.options import MeasurementOptions
from tactuator.rig.rig import Rig, column_of, require_sensors
from tactuator.runtime.simulation import REFERENCE_MAX
from tactuator.signals.decibels import db, from_db
from tactuator.signals.multisine import Band, Multisine, multisine, multisine_lines, require_inside, tones
from tactuator.signals.record import Method, Response
from tactuator.signals.spectra import off_mains

Progress = Callable[[int, int], None]
SoFar = Callable[[tuple[Response, ...]], None]


def stepped_sine(
    rig: Rig,
    frequency_hz: ArrayLike,
    options: MeasurementOptions,
    *,
    progress: Progress | None = None,
    so_far: SoFar | None = None,
    watch: Watch = iter,
) -> tuple[Response, ...]:
    """Measure the response of the loaded controller and display, one Response for each of the channels asked for.

    frequency_hz (m,): any order; each is played as it is, or within 2 % of it where it has to keep 2 Hz off mains.
    After settling it is played in blocks of whole periods until every channel's confidence is reached, or for
    longest_s. After each point, progress is called with the number of points done and of all, so_far with the responses
    of those done; the traces pass through watch.
    Raises BadInput for frequencies outside the band or too near to mains, or an unknown channel.
    """
    columns = check_asked(rig, frequency_hz, options)
    frequencies = tones(frequency_hz, options.mains_hz, options.band_hz or (0.0, 0.45 * rig.rate_hz))
    play, peak = reference_on(rig, columns, watch), float(from_db(options.level_db_sl))
    points: list[Lines] = []
    for hertz in frequencies.tolist():
        tone = Tone(hertz, peak, rig.rate_hz, options.mains_hz)
        points.append(measure_lines(play, rig.rate_hz, columns, tone, options))
        if progress is not None:
            progress(len(points), frequencies.size)
        if so_far is not None:
            so_far(_responses(rig, columns, points, "stepped-sine", options))
    rig.rest()
    return _responses(rig, columns, points, "stepped-sine", options)


def multisine_response(
    rig: Rig,
    frequency_hz: ArrayLike,
    options: MeasurementOptions,
    rng: np.random.Generator,
    *,
    exactly: bool = True,
    settle_s: float = SETTLE_S,
) -> tuple[Response, ...]:
    """Measure the response at `frequency_hz` (m,), all lines at once, one Response for each of the channels asked for.

    Lines are odd multiples of one period's frequency, within 2 % of the requested ones, 2 Hz off mains and inside the
    band; the shortest such period is used. Not `exactly`: the nearest lines inside the band, for a sweep without
    requested frequencies. After settle_s of the same signal two periods are averaged, and more until every line's
    half-width is at most confidence_db or longest_s are over. The half-width covers noise and distortion.
    Raises BadInput as `stepped_sine` does, and for a level at which all lines together pass a reference's full scale.
    """
    columns = check_asked(rig, frequency_hz, options)
    excited = multisine_played(rig, frequency_hz, options, rng, exactly=exactly)
    beyond_db = float(db(np.max(np.abs(excited.one_period())) / REFERENCE_MAX))
    if beyond_db > 0.0:
        level, most = options.level_db_sl, np.floor(10.0 * (options.level_db_sl - beyond_db)) / 10.0
        asked = f"{level:g} dB SL for {excited.bins.size} frequencies at once"
        raise BadInput(asked, f"at most {most:g} dB SL for so many, or `method` stepped", key="level_db_sl")
    return _together(rig, excited, columns, options, settle_s)


def multisine_played(
    rig: Rig, frequency_hz: ArrayLike, options: MeasurementOptions, rng: np.random.Generator, *, exactly: bool = True
) -> Multisine:
    """Return what `multisine_response` plays. Raises BadInput where no period holds the lines."""
    frequency = np.sort(np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64)))
    band_hz = options.band_hz or (0.0, 0.45 * rig.rate_hz)
    period, bins = multisine_lines(frequency, rig.rate_hz, options.longest_s, options.mains_hz, band_hz, exactly)
    return multisine(rig.rate_hz, period, bins, float(from_db(options.level_db_sl)), rng)


_SWEPT_S, _SWEPT_DB_SL, _CREST_DB = 4.0, 40.0, 9.0
"""Period, level of all lines together, and what is left for the crest factor."""


def swept_responses(
    rig: Rig, options: MeasurementOptions, reach_db_sl: Callable[[FloatArray], FloatArray], rng: np.random.Generator
) -> tuple[Response, ...]:
    """Measure at every half hertz of the band at once, off mains, in 9 s: what lies between points.

    reach_db_sl: the greatest level that a tone may have, of frequencies (n,). All lines have 40 dB SL together, or what
    fits into it. The level asked has no part in it: a resonance is as strong at any.
    """
    columns, period = sensed_columns(rig, options.channels), round(_SWEPT_S * rig.rate_hz)
    low, high = options.band_hz or (0.0, 0.45 * rig.rate_hz)
    bins = np.arange(1, period // 2, 2)
    hertz = bins * rig.rate_hz / period
    bins = bins[(low <= hertz) & (hertz <= high) & (off_mains(hertz, options.mains_hz) == hertz)]
    fits_db = -10.0 * np.log10(np.mean(from_db(-reach_db_sl(bins * rig.rate_hz / period)) ** 2)) - _CREST_DB
    together = min(_SWEPT_DB_SL, float(fits_db))
    excited = multisine(rig.rate_hz, period, bins, from_db(together) / np.sqrt(bins.size), rng)
    swept = replace(options, level_db_sl=together, longest_s=2.0 * _SWEPT_S)
    return _together(rig, excited, columns, swept, SETTLE_S)


def _together(
    rig: Rig, excited: Multisine, columns: Sequence[int], options: MeasurementOptions, settle_s: float
) -> tuple[Response, ...]:
    periodic = Periodic(excited, options.mains_hz, settle_s)
    lines = measure_lines(reference_on(rig, columns), rig.rate_hz, columns, periodic, options)
    rig.rest()
    return _responses(rig, columns, [lines], "multisine", options)


def _responses(
    rig: Rig, columns: Sequence[int], parts: Sequence[Lines], method: Method, options: MeasurementOptions
) -> tuple[Response, ...]:
    """Return the response of each column: the lines of all parts, one after another."""
    lines = Lines(*(np.concatenate([getattr(part, each.name) for part in parts], axis=-1) for each in fields(Lines)))
    confidence = lines.confidence_db
    return tuple(
        Response(
            channel=rig.channels[column],
            load=options.load,
            level_db_sl=options.level_db_sl,
            method=method,
            frequency_hz=lines.frequency_hz,
            amplitude_v=lines.amplitude[row],
            reference=lines.reference,
            confidence_db=confidence[row],
            noise_v=lines.noise_v[row],
            distortion_v=lines.distortion_v[row],
            saturated=lines.saturated[row],
            reached=confidence[row] <= options.confidence_db,
            averaged_s=lines.averaged_s,
            controller_hash=options.controller_hash,
        )
        for row, column in enumerate(columns)
    )


def check_asked(rig: Rig, frequency_hz: ArrayLike, options: MeasurementOptions) -> list[int]:
    """Return the columns to measure. Raises BadInput for what cannot be measured."""
    check_frequencies(rig, frequency_hz, options.band_hz)
    return sensed_columns(rig, options.channels)


def check_frequencies(rig: Rig, frequency_hz: ArrayLike, band_hz: Band | None = None) -> None:
    """Raise BadInput for no frequency at all, or one outside the band, or, without a band, at which the rig cannot be
    measured.
    """
    frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    if band_hz is not None:
        for hertz in frequency.tolist():
            require_inside(hertz, band_hz)
    if frequency.size == 0 or not (np.min(frequency) > 0.0 and np.max(frequency) < 0.45 * rig.rate_hz):
        got = f"frequencies {frequency.tolist()} Hz" if frequency.size else "no frequency is given"
        raise BadInput(got, f"above 0, below {0.45 * rig.rate_hz:g} Hz")


def sensed_columns(rig: Rig, channels: Sequence[str] | None) -> list[int]:
    """Return the columns of channels (None: all). Raises BadInput for one that is not there, or has no sensor."""
    names = tuple(channels or rig.channels)
    columns = [column_of(name, rig.channels) for name in names]
    require_sensors(rig, names)
    return columns
