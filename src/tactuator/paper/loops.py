"""Step 5: the paper's C around the paper's motor, continuous and sampled, with its margins."""

from __future__ import annotations

from dataclasses import dataclass

from tactuator.model.description import Channel, Display
from tactuator.signals.discretise import bilinear, zero_order_hold
from tactuator.signals.loop import FeedbackLoop, Margins, margins
from tactuator.synthesis import paper


@dataclass(frozen=True)
class PaperLoop:
    """The loop of the paper's equations and the loop as it runs, with the margins of each."""

    continuous: FeedbackLoop
    continuous_margins: Margins
    sampled: FeedbackLoop
    sampled_margins: Margins


def paper_loop(display: Display) -> PaperLoop:
    """Return the loops of C and P as the paper prints them and as they run: bilinear C, held P, the display's computing
    delay.
    """
    continuous = FeedbackLoop(paper.FEEDBACK, paper.PLANT)
    sampled = sampled_loop(display, display.channels[0])
    return PaperLoop(continuous, margins(continuous), sampled, margins(sampled))


def sampled_loop(display: Display, channel: Channel) -> FeedbackLoop:
    """Return the paper's C on one of the display's channels, as it runs."""
    plant = zero_order_hold(channel.plant, display.rate_hz, display.delay_samples)
    return FeedbackLoop(bilinear(paper.FEEDBACK, display.rate_hz), plant)
