"""A verdict: findings on the paper's objectives, each met, not met or not judged, with what it rests on.

Whoever judges (a model, a measurement, a build) makes findings of one kind, so that a reader compares like with like.
An objective is met only if something was judged and nothing that counts stayed open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.table import brief

OBJECTIVES = {
    "i": "what is felt is what was asked: |H| follows the threshold curve over the band, without load",
    "ii": "every mains line is felt below threshold",
    "iii": "noise is felt below threshold in every third octave, and no resonance stands out",
    "iv": "a finger's load does not change |H| at low frequencies",
    "build": "a board takes the controller as an image",
    "numbers": "what the display and its plant's record say can be, and goes together (told where it does not)",
}
"""What each objective asks for, in words, by its number; verdicts name them in this order."""

FELT_MINUS_ASKED = "felt minus asked"
"""What objective i is judged by: the level that is felt, less the level that was asked for."""
OF_THE_LOOP = ("i", "ii", "iii", "iv")
"""Objectives that a closed loop has to be stable for."""


class Outcome(StrEnum):
    """The fate of an objective, in the words that are printed."""

    MET = "met"
    NOT_MET = "not met"
    NOT_JUDGED = "not judged"


@dataclass(frozen=True)
class Finding:
    """One quantity of one channel under one load.

    value and allowed in `unit`; frequency_hz: where the value was found. remark: why it was not judged, what it rests
    on, or what to change. counts: whether an objective stays open if this was not judged; what is told for
    information only does not. model: whose plant it is about, where a display was measured several times. side: the
    sign of what `value` is the size of (felt minus asked), for those who read it; 0 where it is a value of its own.
    """

    objective: str
    channel: str
    load: str
    outcome: Outcome
    quantity: str
    value: float | None = None
    allowed: float | None = None
    unit: str = ""
    frequency_hz: float | None = None
    remark: str = ""
    counts: bool = True
    model: str = ""
    side: float = 0.0

    __repr__ = brief

    @property
    def excess(self) -> float:
        """Return by how much the value passes what is allowed; -inf where there is nothing to compare."""
        if self.value is None or self.allowed is None:
            return float("-inf")
        return self.value - self.allowed

    @property
    def figure(self) -> str:
        """Return the value as it is read, with the sign of its side and its unit; "—" where there is none."""
        if self.value is None:
            return "—"
        shown = f"{self.side * self.value:+.2f}" if self.side else f"{self.value:.2f}"
        return f"{shown} {self.unit}".rstrip()

    def document(self) -> dict[str, Any]:
        """Return plain figures, as `--json` prints them."""
        plain = {name: value for name, value in vars(self).items() if name != "side"}
        return {**plain, "outcome": self.outcome.value}


def compared(
    objective: str,
    channel: str,
    load: str,
    quantity: str,
    value: float,
    allowed: float,
    unit: str,
    frequency_hz: float | None = None,
    *,
    assumed: str = "",
    remedy: str = "",
) -> Finding:
    """Return the finding that `value` keeps `allowed`, or does not; not judged where it rests on what is `assumed`."""
    met = value <= allowed
    outcome = Outcome.NOT_JUDGED if assumed else Outcome.MET if met else Outcome.NOT_MET
    remark = rests_on(assumed) if assumed else "" if met else remedy
    return Finding(objective, channel, load, outcome, quantity, value, allowed, unit, frequency_hz, remark)


def in_jnd(error_db: float) -> str:
    """Return the remark that tells an error of level in just-noticeable differences of amplitude."""
    return f"{error_db / AMPLITUDE_JND_DB:.1f} just-noticeable differences of {AMPLITUDE_JND_DB:g} dB"


def rests_on(assumed: str) -> str:
    """Return the remark on a figure that rests on what nobody measured: one thing, or several joined by "and"."""
    by = " (`tactuator noise --write` does)" if {"hum", "noise"} & set(assumed.split(" and ")) else ""
    return f"{assumed} {'are' if ' and ' in assumed else 'is'} assumed, not measured{by}"


@dataclass(frozen=True)
class Objective:
    """One objective: its number, words, and findings, in the order of channels and loads."""

    number: str
    words: str
    findings: tuple[Finding, ...]

    __repr__ = brief

    @property
    def outcome(self) -> Outcome:
        """Return not met if any finding is not; met if some are and none that counts stayed open; else not judged."""
        outcomes = [finding.outcome for finding in self.findings]
        open_ones = [finding for finding in self.findings if finding.outcome is Outcome.NOT_JUDGED and finding.counts]
        if Outcome.NOT_MET in outcomes:
            return Outcome.NOT_MET
        return Outcome.MET if Outcome.MET in outcomes and not open_ones else Outcome.NOT_JUDGED

    def worst(self) -> tuple[Finding, ...]:
        """Return one finding for each channel, measured plant and quantity: what is not met before what is open before
        what is met, and of those the one with the greatest excess. This fits a screen at any number of loads."""
        worst: dict[tuple[str, str, str], Finding] = {}
        for finding in self.findings:
            known = worst.get((finding.channel, finding.model, finding.quantity))
            if known is None or _rank(finding) > _rank(known):
                worst[finding.channel, finding.model, finding.quantity] = finding
        return tuple(worst.values())


_GRAVITY = {Outcome.NOT_MET: 2, Outcome.NOT_JUDGED: 0, Outcome.MET: 1}


def _rank(finding: Finding) -> tuple[int, float]:
    gravity = 1 if finding.outcome is Outcome.NOT_JUDGED and finding.counts else _GRAVITY[finding.outcome]
    return gravity, finding.excess


@dataclass(frozen=True)
class Verdict:
    """Objectives, and what was assumed on the way, in sentences."""

    objectives: tuple[Objective, ...]
    assumptions: tuple[str, ...] = ()

    __repr__ = brief

    @property
    def outcome(self) -> Outcome:
        """Return not met if any objective is not; met if all are; else not judged."""
        outcomes = {objective.outcome for objective in self.objectives}
        if Outcome.NOT_MET in outcomes:
            return Outcome.NOT_MET
        return Outcome.MET if outcomes == {Outcome.MET} else Outcome.NOT_JUDGED

    @property
    def sentence(self) -> str:
        """Return the verdict in one sentence."""
        numbers: dict[Outcome, list[str]] = {outcome: [] for outcome in Outcome}
        for objective in self.objectives:
            numbers[objective.outcome].append(objective.number)
        parts = [f"{', '.join(of)}: {outcome}" for outcome, of in numbers.items() if of]
        return f"{self.outcome} ({'; '.join(parts)})"

    def document(self) -> dict[str, Any]:
        """Return plain tables, as `--json` prints them."""
        return {
            "outcome": self.outcome.value,
            "objectives": {
                objective.number: {
                    "outcome": objective.outcome.value,
                    "asks": objective.words,
                    "findings": [finding.document() for finding in objective.findings],
                }
                for objective in self.objectives
            },
            "assumptions": list(self.assumptions),
        }


def verdict_of(findings: Sequence[Finding], assumptions: Sequence[str] = ()) -> Verdict:
    """Return the verdict of findings on any of the objectives, in the order of `OBJECTIVES`."""
    sorted_out = {number: tuple(each for each in findings if each.objective == number) for number in OBJECTIVES}
    objectives = (Objective(number, OBJECTIVES[number], of) for number, of in sorted_out.items() if of)
    return Verdict(tuple(objectives), tuple(dict.fromkeys(assumptions)))
