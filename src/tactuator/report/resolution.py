"""Coefficient resolution against sampling rate: why the paper chose the lowest rate, and why it need not have."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from tactuator.digital.resolution import BitsNeeded
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, GREEN, INK, RED, figure

_WORDS = {"direct": "one direct form", "sections": "second-order sections", "delta": "delta sections"}
_COLOURS = {"direct": BLUE, "sections": RED, "delta": GREEN}


def resolution_plate(needed: Mapping[str, Mapping[str, Mapping[float, BitsNeeded]]], name: str = "resolution") -> Plate:
    """needed: filter ("prefilter F", ...) to form to rate_hz to bits. A panel for each filter: bits to keep 0.1 dB
    (solid) and to be stable (dashed)."""
    made, axes = figure(1, len(needed), height_in=3.6, sharey=True, squeeze=False)
    table: dict[str, list[object]] = {key: [] for key in ("filter", "form", "rate_hz", "stable_bits", "accurate_bits")}
    for panel, (filter_name, forms) in zip(axes[0], needed.items(), strict=True):
        for form, by_rate in forms.items():
            colour = _COLOURS[form]
            rates = list(by_rate)
            accurate = [by_rate[rate].accurate for rate in rates]
            stable = [by_rate[rate].stable for rate in rates]
            label = _WORDS[form] if panel is axes[0, 0] else None
            panel.plot(rates, accurate, "o-", color=colour, markersize=4, label=label)
            panel.plot(rates, stable, "o--", color=colour, markersize=3, linewidth=0.9, fillstyle="none")
            for row in zip(rates, stable, accurate, strict=True):
                for cells, cell in zip(table.values(), (filter_name, form, *row), strict=True):
                    cells.append(cell)
        panel.set_xscale("log", base=2)
        panel.xaxis.set_major_locator(FixedLocator(rates))
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 1000:g}"))
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.set_xlabel("sampling rate (kHz)", fontsize=9)
        panel.set_title(filter_name, fontsize=9)
    axes[0, 0].axhline(15.0, color=INK, linewidth=0.8, linestyle=":")
    axes[0, 0].annotate("Q15", (rates[0], 15.0), (0, 3), textcoords="offset points", fontsize=7)
    axes[0, 0].set_ylabel("fractional bits needed", fontsize=9)
    made.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    caption = (
        "Fractional bits that the coefficients of the paper's filters need so that the response stays within 0.1 dB "
        "over 0.1-300 Hz (solid) and the filter, or its loop, stays stable (dashed)."
    )
    return Plate(name, "Coefficient resolution against sampling rate", caption, made, table)
