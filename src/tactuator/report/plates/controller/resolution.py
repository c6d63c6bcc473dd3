"""Coefficient resolution against sampling rate: why the paper chose the lowest rate, and why it need not have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MultipleLocator, NullFormatter

from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, GREEN, INK, RED, figure
from tactuator.wordlength.bits import MOST_BITS, BitsNeeded

_WORDS = {"direct": "one direct form", "sections": "second-order sections", "delta": "delta sections"}
_COLOURS = {"direct": BLUE, "sections": RED, "delta": GREEN}


def resolution_plate(
    needed: Mapping[str, Mapping[str, Mapping[float, BitsNeeded]]],
    name: str = "resolution",
    whose: str = "the paper's filters",
    band: str = "0.1-300 Hz",
) -> Plate:
    """Draw a panel for each filter: bits to keep 0.1 dB (solid) and to be stable (dashed). needed: filter ("prefilter
    F", ...) to form to rate_hz to bits. whose, band: as the caption tells it.
    """
    made, axes = figure(1, len(needed), height_in=3.6, sharey=True, squeeze=False)
    for panel, (filter_name, forms) in zip(axes[0], needed.items(), strict=True):
        _draw(panel, forms)
        panel.set_title(filter_name, fontsize=9)
        panel.axhline(14.0, color=INK, linewidth=0.8, linestyle=":")
    beside = ("axes fraction", "data")
    axes[0, -1].annotate("16-bit\nwords", (1.0, 14.0), (3, 0), beside, "offset points", fontsize=7, va="center")
    axes[0, 0].set_ylabel("fractional bits needed", fontsize=9)
    axes[0, 0].yaxis.set_major_locator(MultipleLocator(5))
    axes[0, 0].set_ylim(-1.5, None)
    forms_shown = dict.fromkeys(form for forms in needed.values() for form in forms)
    keys = [Line2D([], [], color=_COLOURS[form], label=_WORDS[form]) for form in forms_shown]
    keys += [
        Line2D([], [], color=INK, marker="o", markersize=4, label="within 0.1 dB"),
        Line2D([], [], color=INK, marker="o", markersize=3, fillstyle="none", linestyle="--", label="stable"),
    ]
    made.legend(handles=keys, loc="outside lower center", ncols=5, fontsize=7, frameon=False, columnspacing=1.2)
    caption = (
        f"Fractional bits that the coefficients of {whose} need so that the response stays within 0.1 dB over {band} "
        "(solid) and the filter, or its loop, stays stable (dashed). 16-bit words have 14 for a section's denominator. "
        f"A line ends where {MOST_BITS} bits are not enough."
    )
    return Plate(name, "Coefficient resolution against sampling rate", caption, made, _table(needed))


def _draw(panel: Axes, forms: Mapping[str, Mapping[float, BitsNeeded]]) -> None:
    rates: Sequence[float] = []
    for form, by_rate in forms.items():
        rates = list(by_rate)
        accurate, stable = (
            [getattr(bits, what) if getattr(bits, what) <= MOST_BITS else np.nan for bits in by_rate.values()]
            for what in ("accurate", "stable")
        )
        panel.plot(rates, accurate, "o-", color=_COLOURS[form], markersize=4)
        panel.plot(rates, stable, "o--", color=_COLOURS[form], markersize=3, linewidth=0.9, fillstyle="none")
    panel.set_xscale("log", base=2)
    panel.xaxis.set_major_locator(FixedLocator(rates))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 1000:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_xlabel("sampling rate (kHz)", fontsize=9)


def _table(needed: Mapping[str, Mapping[str, Mapping[float, BitsNeeded]]]) -> dict[str, list[object]]:
    rows = [
        (filter_name, form, rate, bits.stable, bits.accurate)
        for filter_name, forms in needed.items()
        for form, by_rate in forms.items()
        for rate, bits in by_rate.items()
    ]
    columns = ("filter", "form", "rate_hz", "stable_bits", "accurate_bits")
    return {name: list(cells) for name, cells in zip(columns, zip(*rows, strict=True), strict=True)}
