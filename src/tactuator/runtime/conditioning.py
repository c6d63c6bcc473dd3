"""Conditioning: the reference that a cut command is worth, by which the core keeps F and C to what the motor could do.

Where u' is cut to u, the reference of which u is the answer is r + (u - u')/D, D the product of all direct gains from
r to u' (Hanus, Kinnaert & Henrotte 1987, Automatica 23, 729-739): with F and C as that reference would have left them,
the loop is as linear as before, and what is felt is that reference. The core keeps it within comfort (or r).
"""

from __future__ import annotations

import numpy as np

from tactuator.model.controller import ChannelController
from tactuator.signals.decibels import from_db

CONDITIONING_MAX = 1e6
"""Threshold units for a volt; beyond it F hardly reaches u' at once, and nothing is conditioned."""


def conditioning(channel: ChannelController) -> float:
    """Return the threshold units of reference that a volt of command is worth: 1/D; 0 without feedback, or where D is
    next to nothing.
    """
    if channel.feedback_sos is None:
        return 0.0
    sections = np.concatenate([channel.prefilter_sos, channel.feedback_sos])
    direct = float(np.prod(sections[:, 0] / sections[:, 3]))
    return 1.0 / direct if abs(direct) > 1.0 / CONDITIONING_MAX else 0.0


def reference_max(channel: ChannelController) -> float:
    """Return the greatest reference that conditioning may come to, in threshold units: the comfort level."""
    return float(from_db(channel.limits.comfort_db_sl))
