"""A verdict: findings on the paper's objectives, each met, not met or not judged, with what it rests on.

Every judge (a model, a measurement, a build) makes findings of one kind, which can be compared.
An objective is met only if something was judged and nothing that counts stayed open.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from tactuator.model.description import Channel
from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.plain import brief
from tactuator.result import Chart, ChartLine, Fact, Result, ResultTable, data, found
from tactuator.signals.decibels import db

OBJECTIVES = {
    "i": "what is felt is what was asked: |H| follows the threshold curve over the band, without load",
    "ii": "every mains line is felt below threshold",
    "iii": "noise is felt below threshold in every third octave, and no resonance stands out",
    "iv": "a finger's load does not change |H| at low frequencies",
    "build": "a board takes the controller as an image",
    "numbers": "values are possible and fit together (listed only if they do not)",
}
"""What each objective asks for, in words, by its number; verdicts name them in this order."""

LEVEL_ERROR = "level error"
"""What objective i is judged by: the level that is felt, less the level that was asked for."""
MODE_OFF = f"{LEVEL_ERROR}, a mode 2 % off"
"""What is felt without a loop where the resonance has moved by as much as it does with temperature and mounting."""
AT_LOWEST = f"{LEVEL_ERROR}, lowest level"
HEADROOM, FELT_HUM, FELT_NOISE, FELT_STEPS = "missing headroom", "felt hum", "felt noise", "felt steps of the D/A"
_DECIDED: Mapping[str, tuple[str, ...]] = {
    "name": (), "finger": (), "travel_mm": (HEADROOM,), "range_v": (HEADROOM,), "bits": (AT_LOWEST, FELT_STEPS),
    "hum_hz": (FELT_HUM,), "hum_v_peak": (FELT_HUM,), "noise_v_rms": (FELT_NOISE,),
    "friction_v": (AT_LOWEST, FELT_HUM), "presliding_v": (AT_LOWEST,),
}  # fmt: skip
"""Quantities that a key of the display file decides, beside the gain of the sensor and the loads."""
AS_IN_TEMPLATE = "as in the template; what this decides is not judged until you set it and delete CHANGE THIS"
"""What is said of keys whose line still says so."""
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
    on, or what to change. counts: whether an objective stays open if this was not judged; what is only for information
    does not. model: whose plant it is about, where a display was measured several times. side: the sign of what `value`
    is the size of (felt minus requested); 0 if `value` has its own sign.
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
        """Return the value as it is read, with the sign of its side and its unit; "—" without a value."""
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
    """Return the remark that gives a level error in just-noticeable differences of amplitude."""
    return f"{error_db / AMPLITUDE_JND_DB:.1f} just-noticeable differences of {AMPLITUDE_JND_DB:g} dB"


def rests_on(assumed: str) -> str:
    """Return the remark on a figure that rests on what nobody measured: one thing, or several joined by "and"."""
    by = " (`tactuator measure noise --write` does)" if {"hum", "noise"} & set(assumed.split(" and ")) else ""
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


@dataclass(frozen=True, repr=False)
class Verdict(Result):
    """Objectives, and what was assumed on the way, in sentences. It draws how far each finding lies below what is
    allowed.

    beside: facts and tables of what the verdict rests on as well (drawn plants).
    """

    objectives: tuple[Objective, ...]
    assumptions: tuple[str, ...] = ()
    beside: tuple[Fact | ResultTable, ...] = ()

    @property
    def holds(self) -> bool:
        """Return False where a requirement is not met."""
        return self.outcome is not Outcome.NOT_MET

    def told(self) -> list[Fact]:
        """Return the verdict in words, and what of each objective is not met or not judged: each quantity's worst.

        Numbers that can hardly be come first: what follows from them is no better than they are.
        """
        each_open = []
        for objective in sorted(self.objectives, key=lambda each: each.number != "numbers"):
            open_ones = [each for each in objective.findings if each.outcome is objective.outcome is not Outcome.MET]
            of = {each.quantity: each for each in sorted(open_ones, key=lambda each: (each.counts, each.excess))}
            if of:
                each_open.append(
                    found(f"{objective.outcome}, {objective.number}", "; ".join(map(_in_words, of.values())))
                )
        return [found("verdict", self.sentence), *each_open]

    def facts(self) -> Sequence[Fact]:
        """Return the verdict in words and as a document."""
        beside = [each for each in self.beside if isinstance(each, Fact)]
        return [*self.told(), *data(self.document()), *beside]

    def notices(self) -> Sequence[str]:
        """Return what the display still has of its template, and what a mode that is off costs a display without a
        loop, where that is more than is allowed.
        """
        findings = [each for objective in self.objectives for each in objective.findings]
        template = [each for each in self.assumptions if each.endswith(AS_IN_TEMPLATE)]
        return [*template, *(_in_words(each) for each in findings if each.quantity == MODE_OFF and each.excess > 0.0)]

    def next_step(self) -> str:
        """Return where to read on, unless all is met."""
        return "" if self.outcome is Outcome.MET else "--full lists every finding, with what helps"

    def tables(self) -> Sequence[ResultTable | str]:
        """Return a row for each objective, channel and quantity, the worst of its loads, models and lines.

        Remarks, which may be long, are listed below it.
        """
        worst = [finding for objective in self.objectives for finding in objective.worst()]
        assumed = dict.fromkeys(f"assumed: {sentence}" for sentence in self.assumptions)
        whole = ("objective", "outcome", "allowed", "frequency")
        table = ResultTable("", FINDING_COLUMNS, tuple(map(finding_row, worst)), whole=whole)
        beside = [each for each in self.beside if isinstance(each, ResultTable)]
        return [table, *remark_lines(worst), *assumed, *beside]

    def columns(self) -> Mapping[str, Any]:
        """Return a row for each finding."""
        names = ("objective", "channel", "load", "quantity", "value", "allowed", "unit")
        findings = [finding for objective in self.objectives for finding in objective.findings]
        columns = {name: [getattr(finding, name) for finding in findings] for name in names}
        return columns | {"outcome": [str(finding.outcome) for finding in findings]}

    def chart(self) -> Chart:
        """Return how far each finding lies below what is allowed."""
        findings = [f for objective in self.objectives for f in objective.worst() if f.allowed is not None]
        names = list(dict.fromkeys(finding.channel for finding in findings))
        curves = []
        for name in names:
            of = [finding for finding in reversed(findings) if finding.channel == name and finding.value is not None]
            rows = [f"{finding.objective}: {finding.quantity}" for finding in of]
            missed = [finding.outcome is Outcome.NOT_MET for finding in of]
            curves.append(ChartLine(name, [_excess_db(finding) for finding in of], rows, "o", crossed=missed))
        return Chart("value less what is allowed (dB)", "objective: quantity", curves, upright={"allowed": 0.0})

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


def verdict_of(
    findings: Sequence[Finding], assumptions: Sequence[str] = (), channels: Sequence[Channel] = ()
) -> Verdict:
    """Return the verdict of findings on any of the objectives, in the order of `OBJECTIVES`.

    channels: of the display; what a value of its template decides is not judged.
    """
    unchanged = {channel.name: channel.unchanged for channel in channels}
    findings = [_without_template(each, unchanged.get(each.channel, ())) for each in findings]
    sorted_out = {number: tuple(each for each in findings if each.objective == number) for number in OBJECTIVES}
    objectives = (Objective(number, OBJECTIVES[number], of) for number, of in sorted_out.items() if of)
    return Verdict(tuple(objectives), tuple(dict.fromkeys(assumptions)))


def _without_template(finding: Finding, unchanged: Sequence[str]) -> Finding:
    """Return a finding, not judged if it rests on keys that still have the template's value."""
    keys = [key for key in unchanged if _decides(key, finding)]
    if not keys or finding.outcome is Outcome.NOT_JUDGED:
        return finding
    return replace(finding, outcome=Outcome.NOT_JUDGED, remark=rests_on(f"the template's {' and '.join(keys)}"))


def _decides(key: str, finding: Finding) -> bool:
    """Return whether a key of the display file decides a finding; a key that is not listed here decides all."""
    if finding.objective not in OF_THE_LOOP or finding.value is None:
        return False
    if key == "loads":
        return not finding.load.startswith("none")
    if key.startswith("sensor_gain"):
        return finding.objective == "i" or finding.unit == "dB SL"
    return finding.quantity.startswith(_DECIDED.get(key, ""))


FINDING_COLUMNS = ("objective", "channel", "outcome", "found", "allowed", "frequency", "load")


def finding_row(finding: Finding) -> tuple[str, ...]:
    """Return a finding as the cells of `FINDING_COLUMNS`."""
    unit = f" {finding.unit}" if finding.unit else ""
    value = finding.quantity if finding.value is None else f"{finding.quantity} {finding.figure}"
    allowed = "" if finding.allowed is None else f"{'±' if finding.side else ''}{finding.allowed:g}{unit}"
    at = "" if finding.frequency_hz is None else f"{finding.frequency_hz:.4g} Hz"
    return finding.objective, finding.channel, finding.outcome.value, value, allowed, at, load_words(finding.load)


def load_words(name: str) -> str:
    """Return a load, or another model that fits the record under it (`finger, model 2`), as a person reads it."""
    load, _, model = name.partition(", model ")
    words = "free" if load == "none" else load
    return f"{words}, fit {model} of the record" if model else words


def remark_lines(findings: Iterable[Finding]) -> list[str]:
    """Return the findings' remarks, one line each; channels, and objectives, of which the same is said share a line."""
    channels: dict[tuple[str, str], dict[str, None]] = {}
    for finding in findings:
        if finding.remark:
            channels.setdefault((finding.objective, finding.remark), {})[finding.channel] = None
    objectives: dict[tuple[str, str], list[str]] = {}
    for (objective, remark), names in channels.items():
        objectives.setdefault((", ".join(names), remark), []).append(objective)
    return [f"{', '.join(finding)}, {names}: {remark}" for (names, remark), finding in objectives.items()]


def _in_words(finding: Finding) -> str:
    if finding.objective == "numbers":  # its remark is a sentence, with the value and what was likely meant
        return f"{finding.channel}: {finding.remark}"
    _, channel, _, value, allowed, at, load = finding_row(finding)
    words = f"{channel}, {load}: {value}{f' at {at}' if at else ''}{f' (allowed {allowed})' if allowed else ''}"
    return words if finding.value is not None else f"{words}: {finding.remark}"


def _excess_db(finding: Finding) -> float:
    """Return by how many decibels a finding passes what is allowed; a ratio is taken as one of amplitudes."""
    if finding.unit.startswith("dB") or not finding.value or not finding.allowed:
        return finding.excess
    return float(db(finding.value / finding.allowed))
