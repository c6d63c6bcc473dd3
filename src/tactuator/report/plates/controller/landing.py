"""The felt level over time while a finger lands and is lifted: with the feed-forward, and without."""

from __future__ import annotations

import numpy as np

from tactuator.measure.finger.landing import LANDS_S, LIFTED_S, Landing
from tactuator.report.plate import Plate
from tactuator.report.style import BLUE, FAINT, INK, ORANGE, figure


def landing_plate(shown: Landing, name: str, title: str) -> Plate:
    """Draw the change of the felt level against time, adaptive over fixed, and the band of 1 dB about none."""
    made, axes = figure(height_in=3.2)
    axes.axvspan(LANDS_S, LIFTED_S, color=FAINT, alpha=0.3, linewidth=0.0)
    axes.axhspan(-1.0, 1.0, color=BLUE, alpha=0.08, linewidth=0.0)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.plot(shown.time_s, shown.fixed_db, color=ORANGE, linewidth=1.2, linestyle="--", label="fixed")
    axes.plot(shown.time_s, shown.adaptive_db, color=BLUE, linewidth=1.4, label="adaptive")
    reach = max(1.5, 1.15 * float(np.max(np.abs([shown.fixed_db, shown.adaptive_db]))))
    axes.set_ylim(-reach, reach)
    axes.set_xlim(float(shown.time_s[0]), float(shown.time_s[-1]))
    axes.annotate("touched", (LANDS_S, -reach), (4, 4), textcoords="offset points", fontsize=8, color=INK)
    axes.set_xlabel("time (s)", fontsize=9)
    axes.set_ylabel("change of the felt level (dB)", fontsize=9)
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    caption = (
        f"Felt level of {shown.channel} in windows of 0.1 s, against the same run free, while the load {shown.load!r} "
        f"lands and is lifted (grey): five tones at 30 dB SL on the simulated display with hum, noise, friction and "
        f"converters. Adaptive: {_range(shown.adaptive_db)}; fixed: {_range(shown.fixed_db)}. Shaded: within 1 dB."
    )
    table = {
        "time_s": shown.time_s.tolist(),
        "adaptive_db": shown.adaptive_db.tolist(),
        "fixed_db": shown.fixed_db.tolist(),
    }
    return Plate(name, title, caption, made, table)


def _range(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    return f"{float(np.min(values)):+.2f} to {float(np.max(values)):+.2f} dB"
