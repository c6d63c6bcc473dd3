"""The controllers of the study: the paper's C with a prefilter of our own, for one curve or another."""

from __future__ import annotations

from dataclasses import replace

from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.perception.curve import ThresholdCurve
from tactuator.synthesis import paper
from tactuator.synthesis.design import design_controller


def paper_controller(display: Display) -> Controller:
    """Return the paper's C on every channel, and a prefilter of the paper's order fitted to each channel's curve."""
    channels = tuple(replace(one, feedback=replace(one.feedback, structure="paper")) for one in display.channels)
    return design_controller(replace(display, channels=channels), poles=paper.PREFILTER_POLES)


def reshaped_controller(display: Display, curve: ThresholdCurve) -> Controller:
    """Return a controller for another curve: C stays, the prefilters follow the curve over what it covers
    of the band.
    """
    channels = []
    for one in display.channels:
        low, high = one.threshold.band_hz
        band = (max(low, float(curve.frequency_hz[0])), min(high, float(curve.frequency_hz[-1])))
        channels.append(replace(one, threshold=replace(one.threshold, curve=curve, band_hz=band)))
    return paper_controller(replace(display, channels=tuple(channels)))
