"""Step 6: the paper's prefilter and ours, both judged against the curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel, Display
from tactuator.paper.loops import sampled_loop
from tactuator.signals.decibels import db
from tactuator.signals.discretise import bilinear
from tactuator.signals.loop import TwoDegreeLoop
from tactuator.synthesis import paper
from tactuator.synthesis.prefilter import PrefilterFit, fit_prefilter


@dataclass(frozen=True)
class Judged:
    """Error of |H| against the curve over the band, dB: greatest, root mean square even in log frequency, and at every
    frequency_hz, shape (n,)."""

    poles: int
    max_error_db: float
    rms_error_db: float
    frequency_hz: FloatArray
    error_db: FloatArray


@dataclass(frozen=True)
class Prefilters:
    """The paper's F as printed (continuous) and as its bilinear transform runs; ours for every channel (sampled)."""

    paper: Judged
    paper_sampled: Judged
    fitted: dict[str, PrefilterFit]

    @property
    def worst_fitted(self) -> PrefilterFit:
        """Return the fit of the channel with the greatest error."""
        return max(self.fitted.values(), key=lambda fit: fit.max_error_db)


def judge_prefilters(display: Display) -> Prefilters:
    """Judge the paper's F on its own motor, and a prefilter of the same order fitted to H/T for every channel."""
    index = display.channels[0]
    c = bilinear(paper.FEEDBACK, display.rate_hz)
    plant = sampled_loop(display, index).plant
    sampled = TwoDegreeLoop(bilinear(paper.PREFILTER, display.rate_hz), c, plant)
    fitted = {
        channel.name: fit_prefilter(channel, c, display.rate_hz, display.delay_samples, poles=paper.PREFILTER_POLES)
        for channel in display.channels
    }
    return Prefilters(_judged(index, paper_response()), _judged(index, sampled), fitted)


def paper_response() -> TwoDegreeLoop:
    """Return H = F T in continuous time, as the paper prints it; of unit gain at rest."""
    return TwoDegreeLoop(paper.PREFILTER, paper.FEEDBACK, paper.PLANT)


def _judged(channel: Channel, loop: TwoDegreeLoop) -> Judged:
    """Return the error with 0 dB put at the curve's level at its lowest frequency."""
    curve = channel.threshold.curve
    low, high = channel.threshold.band_hz
    own = curve.frequency_hz[(curve.frequency_hz >= low) & (curve.frequency_hz <= high)]
    even = np.geomspace(low, high, 1200)
    frequency = np.unique(np.append(even, own))
    wanted = curve.level_db_re_1um_at(frequency) - curve.level_db_re_1um_at(curve.frequency_hz[0])
    error = db(np.abs(loop.position_response(frequency))) - wanted
    rms = float(np.sqrt(np.mean(error[np.isin(frequency, even)] ** 2)))
    return Judged(paper.PREFILTER_POLES, float(np.max(np.abs(error))), rms, frequency, error)
