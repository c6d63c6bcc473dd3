"""Sets of items for a recognition experiment: waveforms after Tan et al. (1999), and the phonemes of TAPS.

The waveforms are components from kinesthetic to cutaneous, singly and combined, on every group of fingers, at one
duration, in dB SL. The kinds of attributes are those of that work; the numbers are our own and are in the set.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.perception.curve import check_level
from tactuator.signals.excitation import ramps
from tactuator.speech.coding import place
from tactuator.speech.render import RenderJob, write_signal
from tactuator.speech.signal import Signal
from tactuator.speech.taps import CODES, Phoneme, taps_signal

LONGEST_S = 10.0


@dataclass(frozen=True)
class Component:
    """A sinusoid of level_db_sl that begins at zero; name: one letter or a few, of which labels are made."""

    name: str
    frequency_hz: float
    level_db_sl: float

    def __post_init__(self) -> None:
        if not 0.0 < self.frequency_hz <= 300.0:
            raise BadInput(f"component {self.name!r}: {self.frequency_hz:g} Hz", "above 0 to 300 Hz")
        check_level(self.level_db_sl)


KINESTHETIC, MIDDLE, CUTANEOUS = Component("K", 4.0, 40.0), Component("M", 30.0, 40.0), Component("C", 240.0, 40.0)


@dataclass(frozen=True)
class WaveformSet:
    """A set of waveforms. fingers: groups of fingers ("all", or names) that move together. duration_s, ramp_s: of every
    waveform.
    """

    duration_s: float = 0.5
    ramp_s: float = 0.01
    components: tuple[Component, ...] = (KINESTHETIC, MIDDLE, CUTANEOUS)
    fingers: tuple[tuple[str, ...], ...] = (("thumb",), ("index",), ("middle",), ("all",))

    def __post_init__(self) -> None:
        if not 2.0 * self.ramp_s <= self.duration_s <= LONGEST_S or self.ramp_s < 0.0:
            raise BadInput(
                f"waveforms of {self.duration_s:g} s with ramps of {self.ramp_s:g} s",
                f"{LONGEST_S:g} s at most, ramps of half of it at most",
            )
        names = [component.name for component in self.components]
        if not names or len(set(names)) != len(names) or not self.fingers:
            raise BadInput(f"waveforms of components {', '.join(names)}", "each once, one or more, and fingers")

    def labels(self) -> dict[str, tuple[tuple[Component, ...], tuple[str, ...]]]:
        """Return the label of every waveform, such as KC-index, with its components and fingers."""
        labels = {}
        for fingers in self.fingers:
            for count in range(1, len(self.components) + 1):
                for chosen in combinations(self.components, count):
                    label = f"{''.join(component.name for component in chosen)}-{'+'.join(fingers)}"
                    labels[label] = (chosen, fingers)
        return labels

    def reference(self, label: str, fingers: tuple[str, ...], rate_hz: float) -> FloatArray:
        """Return the waveform of that label, (n, fingers), threshold units. Raises BadInput for a label or finger that
        is not there.
        """
        labels = self.labels()
        if label not in labels:
            raise BadInput(f"waveform {label!r}", f"{', '.join(labels)}")
        components, where = labels[label]
        count = round(self.duration_s * rate_hz)
        time = np.arange(count) / rate_hz
        wave = sum(10.0 ** (c.level_db_sl / 20.0) * np.sin(2.0 * np.pi * c.frequency_hz * time) for c in components)
        return np.asarray((wave * ramps(count, rate_hz, self.ramp_s))[:, None] * place([where], fingers))


@dataclass(frozen=True)
class WrittenItem:
    """An item as it was written; max_reduction_db: the limiter's, on the finger where it was greatest."""

    label: str
    path: Path
    max_reduction_db: float


def write_waveforms(waveforms: WaveformSet, controller: Controller, folder: str | Path) -> tuple[WrittenItem, ...]:
    """Write every waveform of the set as a reference FOLDER/LABEL.wav within the display's limits, like speech."""
    fingers = tuple(channel.finger for channel in controller.display.channels)
    asked = {label: waveforms.reference(label, fingers, controller.rate_hz) for label in waveforms.labels()}
    signals = {label: Signal(len(wave), iter([wave]), {}) for label, wave in asked.items()}
    return _written(signals, controller, Path(folder), {"waveforms": asdict(waveforms)})


def write_phonemes(
    controller: Controller, level_db_sl: float, layout: tuple[int, ...], folder: str | Path
) -> tuple[WrittenItem, ...]:
    """Write the code of each of the 39 phonemes of TAPS as a reference FOLDER/NAME.wav; see `taps_signal`."""
    signals = {name: taps_signal((Phoneme(name),), controller, level_db_sl, layout) for name in CODES}
    about = {"coding": "taps", "level_db_sl": level_db_sl, "layout": list(layout)}
    return _written(signals, controller, Path(folder), about)


def _written(
    signals: Mapping[str, Signal], controller: Controller, folder: Path, about: dict[str, Any]
) -> tuple[WrittenItem, ...]:
    job, items = RenderJob(controller), []
    for label, signal in signals.items():
        provenance = {"label": label, "controller": controller.content_hash, **about}
        rendered = write_signal(signal, folder / f"{label}.wav", job, provenance)
        reduction_db = max(entry.max_reduction_db for entry in rendered.limiting)
        items.append(WrittenItem(label, folder / f"{label}.wav", reduction_db))
    return tuple(items)
