"""Sets of synthetic waveforms after Tan et al. (1999): components from kinesthetic to cutaneous, singly and combined.

Every combination of components, on every group of fingers, at one duration, in dB SL. The kinds of attributes are those
of that work; the numbers are our own and stand in the set.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.io.reference import ReferenceHead, curves_of, write_reference
from tactuator.model.controller import Controller
from tactuator.perception.curve import check_level
from tactuator.signals.excitation import ramps
from tactuator.speech.coding import place
from tactuator.speech.limiter import Limiter

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
class WrittenWaveform:
    """A waveform as it was written; max_reduction_db: the limiter's, on the finger where it was greatest."""

    label: str
    path: Path
    max_reduction_db: float


def write_waveforms(waveforms: WaveformSet, controller: Controller, folder: str | Path) -> tuple[WrittenWaveform, ...]:
    """Write every waveform of the set as a reference FOLDER/LABEL.wav within the display's limits, like speech."""
    folder = Path(folder)
    channels = controller.display.channels
    curves = curves_of(channels)
    common: dict[str, Any] = {"controller": controller.content_hash, "waveforms": asdict(waveforms)}
    written = []
    for label in waveforms.labels():
        asked = waveforms.reference(label, tuple(c.finger for c in channels), controller.rate_hz)
        limiter = Limiter(controller)
        blocks = list(limiter.process([asked]))
        head = ReferenceHead(
            controller.rate_hz, tuple(c.name for c in channels), curves, provenance={"label": label, **common}
        )
        with write_reference(folder / f"{label}.wav", head) as writer:
            for block in blocks:
                writer.write(block)
        written.append(
            WrittenWaveform(label, folder / f"{label}.wav", max(entry.max_reduction_db for entry in limiter.report))
        )
    return tuple(written)
