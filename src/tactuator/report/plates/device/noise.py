"""Noise that a resting finger would feel: mains lines, third octaves and the loop's resonance against threshold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes

from tactuator.measure.noise import FeltNoise
from tactuator.report.plate import Plate
from tactuator.report.style import INK, RED, figure, frequency_axis


def noise_plate(proportional: Mapping[float, FeltNoise], designed: FeltNoise, name: str = "noise") -> Plate:
    """Draw one channel: felt third octaves (left), mains lines (right), by proportional gain and under the designed
    loop.
    """
    made, (left, right) = figure(1, 2, height_in=4.2, sharey=True)
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(proportional)))
    for shade, (gain, heard) in zip(shades, proportional.items(), strict=True):
        _draw(left, right, heard, tuple(shade), f"gain {gain:g}", 1.0)
    _draw(left, right, designed, RED, "designed loop", 2.0)
    low, high = float(designed.band_hz.min()), float(designed.band_hz.max())
    frequency_axis(left, low / 1.2, high * 1.2)
    right.set_xlabel("frequency (Hz)", fontsize=9)
    right.set_xticks(designed.line_hz)
    left.set_ylabel("felt level (dB SL)", fontsize=9)
    left.set_title("third octaves", fontsize=9)
    right.set_title("mains lines", fontsize=9)
    for axes in (left, right):
        axes.axhline(0.0, color=INK, linewidth=1.0)
    left.annotate("threshold", (low, 0.0), (0, -10), textcoords="offset points", fontsize=7)
    made.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    caption = (
        f"Channel {designed.channel} at rest, judged from the command through the motor's model: under a proportional "
        f"controller of rising gain and under the designed loop, whose strongest line is felt at "
        f"{designed.worst_line_db_sl:.1f} dB SL and strongest third octave at {designed.band_db_sl.max():.1f} dB SL."
    )
    return Plate(name, "Felt hum and noise", caption, made, _table(proportional, designed))


def _draw(left: Axes, right: Axes, heard: FeltNoise, colour: object, label: str, width: float) -> None:
    left.plot(heard.band_hz, heard.band_db_sl, color=colour, linewidth=width, label=label)
    right.plot(heard.line_hz, heard.line_db_sl, "o-", color=colour, linewidth=width, markersize=3)
    if heard.resonance_hz is not None and heard.resonance_db_sl is not None:
        left.plot(heard.resonance_hz, heard.resonance_db_sl, "v", color=colour, markersize=6)


def _table(proportional: Mapping[float, FeltNoise], designed: FeltNoise) -> dict[str, list[object]]:
    table: dict[str, list[object]] = {"controller": [], "kind": [], "frequency_hz": [], "level_db_sl": []}
    named = [*((f"gain {gain:g}", heard) for gain, heard in proportional.items()), ("designed", designed)]
    for controller, heard in named:
        kinds = (("line", heard.line_hz, heard.line_db_sl), ("third octave", heard.band_hz, heard.band_db_sl))
        for kind, frequency, level in kinds:
            for row in zip(frequency.tolist(), level.tolist(), strict=True):
                for cells, cell in zip(table.values(), (controller, kind, *row), strict=True):
                    cells.append(cell)
    return table
