"""A respondent that judges by what reaches the finger ports."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.experiment.protocol.recognition import ABX_RESPONSES
from tactuator.experiment.session.presented_session import Respondent
from tactuator.experiment.session.session import Acknowledged
from tactuator.experiment.store.records import PlayedTrial
from tactuator.experiment.trial import Trial
from tactuator.model.description import Display
from tactuator.rig.rig import Rig
from tactuator.signals.spectra import third_octave_bands


@dataclass
class FeelingRespondent(Respondent):
    """A respondent that knows items by the levels in third octaves that reached the fingers.

    In training with feedback it keeps the mean pattern of every item. Then it answers the item whose pattern is nearest
    to what it felt, with normal noise of standard deviation noise_db added in every band and finger. Call `listen`
    first.
    """

    paradigm: str
    display: Display
    rng: np.random.Generator
    noise_db: float = 2.0
    slices: int = 3
    _felt: dict[str, list[FloatArray]] = field(default_factory=dict)
    _intervals: list[list[FloatArray]] = field(default_factory=list)
    _known: dict[str, list[FloatArray]] = field(default_factory=dict)

    def listen(self, rig: Rig) -> None:
        """Put the respondent's fingers on the finger ports of all channels."""
        for channel in self.display.channels:
            blocks: list[FloatArray] = []
            self._felt[channel.name] = blocks
            rig.finger(channel.name).attach(blocks.append)

    def presented(self, played: PlayedTrial) -> None:
        """Take each interval out of what was felt while the trial was played, by the rig's times."""
        rate_hz = self.display.rate_hz
        whole = [np.concatenate(blocks)[-round(played.lasted_s * rate_hz) :] for blocks in self._felt.values()]
        spans = [
            (round((interval.onset_s or 0.0) * rate_hz), round((interval.duration_s or 0.0) * rate_hz))
            for interval in played.intervals
        ]
        self._intervals = [[felt[onset : onset + count] for felt in whole] for onset, count in spans]
        for blocks in self._felt.values():
            blocks.clear()

    def respond(self, trial: Trial) -> str:
        """Return the nearest item, or a guess where nothing was learnt."""
        patterns = [self._pattern(interval) for interval in self._intervals]
        if self.paradigm == "abx":
            a, b, x = patterns
            return ABX_RESPONSES[int(_distance(b, x) < _distance(a, x))]
        asked = patterns[1] if self.paradigm == "middle-of-three" else patterns[0]
        self._last = asked
        if not self._known:
            return trial.responses[int(self.rng.integers(len(trial.responses)))]
        return min(self._known, key=lambda label: _distance(np.mean(self._known[label], axis=0), asked))

    def learn(self, trial: Trial, acknowledged: Acknowledged) -> None:
        """Keep what was felt under the item that was asked for."""
        if self.paradigm != "abx":
            self._known.setdefault(trial.correct, []).append(self._last)

    def _pattern(self, fingers: list[FloatArray]) -> FloatArray:
        """Return levels above threshold, dB, of (fingers, slices of time, bands), with the respondent's own noise."""
        levels = []
        for channel, displacement in zip(self.display.channels, fingers, strict=True):
            for part in np.array_split(displacement - displacement.mean(), self.slices):
                spectrum = np.abs(np.fft.rfft(part * np.hanning(len(part))))
                frequency = np.fft.rfftfreq(len(part), 1.0 / self.display.rate_hz)
                felt = spectrum / channel.threshold.curve.displacement_mm(frequency) * 4.0 / len(part)
                for band in third_octave_bands(8.0, 300.0):
                    inside = (frequency >= band.low_hz) & (frequency < band.high_hz)
                    power = float(np.sum(felt[inside] ** 2)) if inside.any() else 0.0
                    levels.append(max(0.0, 10.0 * np.log10(power + 1e-12)))
        return np.array(levels) + self.noise_db * self.rng.standard_normal(len(levels))


def _distance(first: FloatArray, second: FloatArray) -> float:
    return float(np.sum((first - second) ** 2))
