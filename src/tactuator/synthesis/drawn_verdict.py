"""The verdict on plants that were drawn: do nearly all that the display may be keep its limits?

A limit is kept if, as far as that many plants can tell, no more than one in twenty passes it, an unstable loop passing
every limit; and no loop at all may be unstable. The number of plants that pass is binomial: its exact tails exclude,
with 95 % confidence, a share of 5 % from above (met) or from below (not met), or neither (not judged; more plants would
tell). (Clopper & Pearson 1934, "The use of confidence or fiducial limits illustrated in the case of the binomial",
Biometrika 26.)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from tactuator.arrays import FloatArray
from tactuator.model.description import Channel, Display
from tactuator.model.verdict import Finding, Outcome, rests_on
from tactuator.synthesis.family import UNLOADED
from tactuator.synthesis.monte_carlo import QUANTILES, DrawnPlants
from tactuator.synthesis.verdict import unsure

MAY_PASS, CONFIDENCE = 0.05, 0.95
"""Share of plants that may pass a limit, and the confidence with which that is told."""
_AT = QUANTILES.index(1.0 - MAY_PASS)
_UNSTABLE = "unstable loops"


def judge_drawn(drawn: Sequence[DrawnPlants], display: Display) -> list[Finding]:
    """Return the findings on plants drawn for `display`'s channels: stability and max|S| (iii), flatness without load
    (i), felt hum (ii)."""
    return [finding for one in drawn for finding in _findings(one, display.channel(one.channel), display)]


def drawn_assumptions(drawn: Sequence[DrawnPlants]) -> tuple[str, ...]:
    """Return what the draws assume, one sentence each."""
    shifts = {one.channel: one.mode_shift for one in drawn if one.mode_shift > 0.0}
    return tuple(
        f"modes of {name}: {100.0 * shift:g} % of standard deviation in frequency (--mode-shift)"
        for name, shift in shifts.items()
    )


def _findings(one: DrawnPlants, channel: Channel, display: Display) -> Iterator[Finding]:
    asked = display.objectives
    if np.any(np.isfinite(one.sensitivity_peak)) or one.unstable > 0.0:
        yield _judged(one, "iii", _UNSTABLE, np.where(one.stable, 0.0, 100.0), 0.0, "%")
        peak = channel.feedback.sensitivity_peak
        if peak is not None:
            yield _judged(one, "iii", "max|S|", one.sensitivity_peak, peak, "")
    if one.load == UNLOADED:
        found = _judged(one, "i", "error of |H|", one.flatness_db + channel.model_error_db, asked.flatness_db, "dB")
        found = unsure(found, channel) if channel.model_error_db > 0.0 else found
        yield _open(found, "the plant is not known over the whole band (valid_hz)") if _is_beyond(channel) else found
    if np.any(np.isfinite(one.felt_hum_db_sl)):
        hum = _judged(one, "ii", "felt hum", one.felt_hum_db_sl, asked.mains_max_db_sl, "dB SL")
        assumed = [what for what in ("hum", "friction") if what in channel.environment.assumed]
        yield _open(hum, rests_on(" and ".join(assumed))) if assumed else hum


def _judged(one: DrawnPlants, objective: str, quantity: str, values: FloatArray, allowed: float, unit: str) -> Finding:
    """Return the finding that no more than `MAY_PASS` of the plants pass `allowed`."""
    passing = int(np.sum(~(values <= allowed)))
    few = float(special.bdtr(passing, one.count, MAY_PASS)) <= 1.0 - CONFIDENCE
    many = passing > 0 and float(special.bdtrc(passing - 1, one.count, MAY_PASS)) <= 1.0 - CONFIDENCE
    if quantity == _UNSTABLE:
        few, many = few and passing == 0, passing > 0
    outcome = Outcome.MET if few else Outcome.NOT_MET if many else Outcome.NOT_JUDGED
    share = f"{passing} of {one.count} plants drawn from the {one.source} pass it"
    remarks = {
        Outcome.MET: share,
        Outcome.NOT_MET: f"{share}; more reserve in [feedback], or a plant that is better known",
        Outcome.NOT_JUDGED: f"{share}: too few to tell whether 5 % do; more plants (--monte-carlo)",
    }
    if quantity == _UNSTABLE:
        value = 100.0 * one.unstable
    else:
        value = float(np.quantile(np.where(np.isfinite(values), values, np.inf), QUANTILES[_AT], method="higher"))
    named = quantity if quantity == _UNSTABLE else f"{quantity}, 95 % of plants"
    found = Finding(
        objective, one.channel, one.load, outcome, named, value if np.isfinite(value) else None, allowed, unit,
        remark=remarks[outcome],
    )  # fmt: skip
    if one.source == "nominal":
        return _open(found, "nothing tells how the plant may differ; a model by `identify`, a covariance or a family")
    return found


def _open(found: Finding, why: str) -> Finding:
    return replace(found, outcome=Outcome.NOT_JUDGED, remark=why)


def _is_beyond(channel: Channel) -> bool:
    """Tell whether the band reaches beyond the frequencies at which the plant is known."""
    return not all(channel.is_known(edge) for edge in channel.threshold.band_hz)
