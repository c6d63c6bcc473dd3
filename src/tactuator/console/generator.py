"""The generator of the scope: tone, noise, sweep or a reference file, at a level in dB SL, without a click."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import scipy
from pydantic import Field

from tactuator.arrays import FloatArray
from tactuator.console.fields import CHANNELS_MAX, Finite, Name, PageSetting
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceFile, open_reference
from tactuator.model.description import Display
from tactuator.perception.curve import COMFORT_DB_SL, LOWEST_DB_SL
from tactuator.signals.decibels import db, from_db

RAMP_S = 0.1
Kind = Literal["tone", "noise", "sweep", "file"]
MOST_DB_SL: dict[str, float] = {"tone": COMFORT_DB_SL, "sweep": COMFORT_DB_SL, "file": COMFORT_DB_SL, "noise": 45.0}
"""Greatest level of each kind. Noise: 10 dB less, since its samples go to more than four times its rms."""
Hertz = Annotated[Finite, Field(gt=0.0, le=1e5)]
_ORDER = 4


@dataclass(frozen=True)
class GeneratorWave(PageSetting):
    """Setting of the generator. level_db_sl: of the sinusoid; of noise, the sinusoid of equal power; of a file, its
    greatest sample. frequency_hz: of the tone, or where a sweep begins; to_hz and sweep_s: where it turns, and when.
    file: path of the reference, or its key as a page names it.
    """

    kind: Kind
    level_db_sl: Finite
    channels: Annotated[tuple[Name, ...], Field(max_length=CHANNELS_MAX, min_length=1)]
    frequency_hz: Hertz = 100.0
    to_hz: Hertz = 300.0
    sweep_s: Annotated[Finite, Field(gt=0.0)] = 5.0
    file: Name = ""


class Generator:
    """Blocks of reference (n, channels), threshold units, for the channels of `display`.

    A change of level or kind and the end are ramped over RAMP_S; a tone's frequency changes without a jump of phase.
    ScopeSamples beyond comfort, which noise has now and then, are held there.
    """

    def __init__(self, display: Display, rng: np.random.Generator) -> None:
        self._display, self._rng = display, rng
        self._names = tuple(channel.name for channel in display.channels)
        self._wave: GeneratorWave | None = None
        self._next: GeneratorWave | None = None
        self._source: Iterator[FloatArray] = iter(())
        self._gain = self._phase = self._towards = self._step = 0.0
        self._frequency = 0.0
        self._file_peak = 1.0
        self._position_s = 0.0
        self._columns = np.zeros(len(self._names))
        self._unplayed = np.zeros((0, len(self._names)))

    @property
    def wave(self) -> GeneratorWave | None:
        """Return what is played, or will be when the ramp of what came before it is over; None: nothing."""
        return self._next

    @property
    def silent(self) -> bool:
        """Return whether nothing is played, and nothing asked for."""
        return self._wave is None and self._next is None

    def ask(self, wave: GeneratorWave | None) -> None:
        """Play that from now on, or None for silence. Raises BadInput, and goes on with what is played, for a setting
        that cannot be played.
        """
        if wave is not None:
            self._check(wave)
        self._next = wave

    def block(self, count: int) -> FloatArray:
        """Return the next `count` rows."""
        same = self._wave is not None and self._next is not None and _goes_on(self._wave, self._next)
        if same or self._gain == 0.0:
            self._change()
        if self._wave is None:
            return np.zeros((count, len(self._names)))
        target = self._target(self._wave) if same or self._wave == self._next else 0.0
        rows = self._take(count) * self._ramp(count, target)[:, None]
        most = float(from_db(COMFORT_DB_SL))
        return np.clip(rows, -most, most)

    def _check(self, wave: GeneratorWave) -> None:
        most = MOST_DB_SL[wave.kind]
        if not LOWEST_DB_SL <= wave.level_db_sl <= most:
            bounds = f"{LOWEST_DB_SL:g} to {most:g} dB SL for {wave.kind}"
            raise BadInput(f"{wave.level_db_sl:g}", bounds, key="level_db_sl")
        unknown = [name for name in wave.channels if name not in self._names]
        if unknown or not wave.channels:
            raise BadInput(f"channels {', '.join(unknown) or 'none'}", f"{', '.join(self._names)}")
        top = 0.45 * self._display.rate_hz
        asked = {"tone": [wave.frequency_hz], "sweep": [wave.frequency_hz, wave.to_hz]}.get(wave.kind, [])
        for value in asked:
            if not 0.0 < value <= top:
                raise BadInput(f"frequency {value:g} Hz", f"above 0, up to {top:g} Hz")
        if wave.kind == "sweep" and not (0.1 <= wave.sweep_s <= 600.0 and wave.to_hz != wave.frequency_hz):
            raise BadInput("sweep", "between two frequencies, in 0.1 to 600 s")
        if wave.kind == "file":
            self._opened(wave)

    def _change(self) -> None:
        """Take up what was asked for, where what was played is silent or goes on with it."""
        before, self._wave = self._wave, self._next
        if self._wave is None or before == self._wave:
            return
        wave = self._wave
        self._columns = np.array([float(name in wave.channels) for name in self._names])
        if before is not None and self._gain != 0.0:
            return
        self._phase, self._position_s, self._frequency = 0.0, 0.0, wave.frequency_hz
        self._unplayed = np.zeros((0, len(self._names)))
        if wave.kind == "noise":
            self._filters = [
                _band(channel.threshold.band_hz, self._display.rate_hz) for channel in self._display.channels
            ]
            self._states = [np.zeros((len(sections), 2)) for sections, _ in self._filters]
        elif wave.kind == "file":
            reference = self._opened(wave)
            columns = [reference.head.channels.index(name) for name in self._names]
            self._file_peak = max(peaks_of(reference).values())
            self._source = (block[:, columns] for block in reference.blocks())
            self._gain = self._towards = self._target(wave)  # it has ramps already

    def _target(self, wave: GeneratorWave) -> float:
        peak = self._file_peak if wave.kind == "file" else 1.0
        if wave.kind == "file" and abs(wave.level_db_sl - float(db(peak))) < 0.05:
            return 1.0  # as the file has it
        return float(from_db(wave.level_db_sl)) / max(peak, 1e-12)

    def _ramp(self, count: int, target: float) -> FloatArray:
        """Return the gain of the next rows, which reaches the target RAMP_S after it was set."""
        if target != self._towards:
            self._towards, self._step = target, abs(target - self._gain) / (RAMP_S * self._display.rate_hz)
        distance = abs(target - self._gain)
        steps = self._step * np.arange(1, count + 1)
        gains = np.where(steps < distance, self._gain + np.sign(target - self._gain) * steps, target)
        self._gain = float(gains[-1])
        return np.asarray(gains)

    def _take(self, count: int) -> FloatArray:
        wave = self._wave
        assert wave is not None
        if wave.kind == "tone":
            self._frequency = wave.frequency_hz
            return self._sinusoid(np.full(count, wave.frequency_hz))
        if wave.kind == "sweep":
            time = self._position_s + np.arange(count) / self._display.rate_hz
            self._position_s += count / self._display.rate_hz
            share = 1.0 - np.abs((time / wave.sweep_s) % 2.0 - 1.0)
            return self._sinusoid(wave.frequency_hz * (wave.to_hz / wave.frequency_hz) ** share)
        if wave.kind == "noise":
            return self._noise(count) * self._columns
        return self._file(count) * self._columns

    def _sinusoid(self, frequency_hz: FloatArray) -> FloatArray:
        turns = self._phase + np.cumsum(frequency_hz) / self._display.rate_hz
        self._phase = float(turns[-1] % 1.0)
        return np.asarray(np.sin(2.0 * np.pi * turns)[:, None] * self._columns)

    def _noise(self, count: int) -> FloatArray:
        noise = np.empty((count, len(self._names)))
        for index, (sections, gain) in enumerate(self._filters):
            white = self._rng.standard_normal(count)
            noise[:, index], self._states[index] = scipy.signal.sosfilt(sections, gain * white, zi=self._states[index])
        return noise

    def _file(self, count: int) -> FloatArray:
        while len(self._unplayed) < count:
            more = next(self._source, None)
            if more is None:
                self._next = None  # it is over
                break
            self._unplayed = np.concatenate((self._unplayed, more))
        taken, self._unplayed = self._unplayed[:count], self._unplayed[count:]
        return np.concatenate((taken, np.zeros((count - len(taken), len(self._names)))))

    def _opened(self, wave: GeneratorWave) -> ReferenceFile:
        reference = open_reference(Path(wave.file))
        head, rate = reference.head, self._display.rate_hz
        if head.rate_hz != rate or set(head.channels) != set(self._names):
            raise BadInput(
                f"reference of {head.rate_hz:g} Hz for {', '.join(head.channels)}",
                f"{rate:g} Hz for {', '.join(self._names)} on this rig",
            )
        return reference


def peaks_of(reference: ReferenceFile) -> dict[str, float]:
    """Return the greatest sample of each channel of a reference, threshold units."""
    names = reference.head.channels
    peaks = np.max([np.zeros(len(names)), *(np.abs(block).max(axis=0, initial=0.0) for block in reference.blocks())], 0)
    return dict(zip(names, peaks.tolist(), strict=True))


def _goes_on(before: GeneratorWave, after: GeneratorWave) -> bool:
    """Return whether one follows from the other without a pause: another level, or another frequency of a tone."""
    rest = () if before.kind == "tone" else ("frequency_hz", "to_hz", "sweep_s", "file")
    return all(getattr(before, name) == getattr(after, name) for name in ("kind", "channels", *rest))


def _band(band_hz: tuple[float, float], rate_hz: float) -> tuple[FloatArray, float]:
    """Return the sections of a band-pass, and the gain with which white noise of unit variance comes out with the power
    of a sinusoid of amplitude 1.
    """
    high = min(band_hz[1], 0.45 * rate_hz)
    sections = scipy.signal.butter(_ORDER, (band_hz[0], high), "bandpass", fs=rate_hz, output="sos")
    _, response = scipy.signal.sosfreqz(sections, 1 << 15)
    return sections, float(np.sqrt(0.5 / np.mean(np.abs(response) ** 2)))
