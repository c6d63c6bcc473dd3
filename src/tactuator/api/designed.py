"""Controllers and verdicts with a result's manners."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tactuator.api.parameters import Place
from tactuator.arrays import ComplexArray
from tactuator.io.controller import write_controller
from tactuator.measure.error import expected_response
from tactuator.model.controller import Controller
from tactuator.model.verdict import Finding, Outcome, Verdict
from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.report.tables import FINDING_COLUMNS, design_rows, finding_row, printed_factors, remark_lines
from tactuator.result import Fact, Result, data, found, in_a_line
from tactuator.signals.decibels import db
from tactuator.synthesis.exchange import continuous_form
from tactuator.synthesis.monte_carlo import DrawnPlants
from tactuator.synthesis.verdict import whole_verdict
from tactuator.table import FREQUENCY, Chart, ChartLine, ResultTable


def verdict_facts(verdict: Verdict) -> list[Fact]:
    """Return the verdict, and the worst of each objective that is not met; and its document for JSON."""
    missed = [finding for objective in verdict.objectives for finding in objective.worst()]
    missed = [finding for finding in missed if finding.outcome is Outcome.NOT_MET]
    worst = {finding.objective: finding for finding in sorted(missed, key=lambda finding: finding.excess)}
    return [
        found("verdict", verdict.sentence),
        *(found(f"not met, {number}", _in_words(finding)) for number, finding in sorted(worst.items())),
        *data(verdict.document()),
    ]


def _in_words(finding: Finding) -> str:
    _, channel, _, value, allowed, at, load = finding_row(finding)
    words = f"{channel}, {load}: {value}{f' at {at}' if at else ''}{f' (allowed {allowed})' if allowed else ''}"
    return words if finding.value is not None else f"{words}: {finding.remark}"


def verdict_tables(verdict: Verdict) -> list[ResultTable | str]:
    """Return a table of one row for each objective, channel and quantity, the worst of its loads, models and lines.

    Remarks, which may be long, are listed below it.
    """
    worst = [finding for objective in verdict.objectives for finding in objective.worst()]
    assumed = dict.fromkeys(f"assumed: {sentence}" for sentence in verdict.assumptions)
    whole = ("objective", "outcome", "allowed", "frequency")
    table = ResultTable("", FINDING_COLUMNS, tuple(map(finding_row, worst)), whole=whole)
    return [table, *remark_lines(worst), *assumed]


class ControllerResult(Result, Controller):
    """A controller. It draws what its model expects to be felt, less what is asked, free and under each load."""

    @cached_property
    def verdict(self) -> Verdict:
        """Return the verdict on the objectives and on building an image."""
        return whole_verdict(self)

    @property
    def holds(self) -> bool:
        return self.verdict.outcome is not Outcome.NOT_MET

    def notices(self) -> Sequence[str]:
        return [notice for channel in self.display.channels for notice in channel.contact_notices()]

    def next_step(self) -> str:
        return "tactuator build" if self.holds else "--full lists every finding, with what helps"

    def __repr__(self) -> str:
        """Return rate and channels in a line; the verdict takes a while."""
        return in_a_line("Controller", {fact.words: fact.text for fact in self._figures() if fact.words})

    def facts(self) -> Sequence[Fact]:
        told = (fact for fact in verdict_facts(self.verdict) if fact.words)
        return [*told, *self._figures(), Fact("verdict", self.verdict.document())]

    def _figures(self) -> list[Fact]:
        facts = [found("rate", self.rate_hz, "Hz")]
        for channel in self.channels:
            margins, fit = channel.report.get("margins") or {}, channel.report.get("prefilter") or {}
            margin = f"phase margin {margins['phase_margin_deg']:.1f}°, " if margins else ""
            error_db = fit.get("max_error_db", np.nan)
            facts.append(found(channel.name, f"{margin}prefilter within {error_db:.2f} dB without friction"))
            facts.append(Fact(channel.name, dict(channel.report)))
        return facts

    def tables(self) -> Sequence[ResultTable | str]:
        columns = ("figure (worst over the loads)", *(channel.name for channel in self.channels))
        beyond = {channel.name: channel.unknown_words for channel in self.display.channels}
        return [
            *(f"{name}: {words}" for name, words in beyond.items() if words),
            ResultTable("Design", columns, tuple(design_rows(self.channels))),
            *self._factors(),
            *verdict_tables(self.verdict),
        ]

    def _factors(self) -> Iterator[str]:
        """Yield C and F in continuous form (whose bilinear transform the sections are), in factors, as a paper does."""
        for channel in self.channels:
            for letter, system in (("C", channel.feedback(self.rate_hz)), ("F", channel.prefilter(self.rate_hz))):
                if system is not None:
                    yield f"{channel.name}: {letter}(s) = {printed_factors(continuous_form(system))}"

    def chart(self) -> Chart:
        curves = []
        for number, channel in enumerate(self.display.channels):
            hertz = np.geomspace(*channel.threshold.band_hz, 300)
            unit_v = channel.prefilter_voltage(hertz)
            for load in (None, *(load.name for load in channel.loads)):
                error = db(self.response(channel.name, hertz, load) / unit_v)
                words, style = (channel.name, "-") if load is None else (f"{channel.name}, {load}", "--")
                curves.append(ChartLine(words, hertz, error, style, colour=number))
        tolerance, label = self.display.objectives.flatness_db, "felt minus asked, by the model (dB)"
        return Chart(FREQUENCY, label, curves, True, (0.0,), tolerance, AMPLITUDE_JND_DB)

    def response(self, channel: str, frequency_hz: ArrayLike, load: str | None = None) -> ComplexArray:
        """Return the volts of y per threshold unit that the model expects of a channel, (m,); load: None for free."""
        return expected_response(self, channel, load, np.asarray(frequency_hz, dtype=np.float64))

    def write(self, path: Place) -> None:
        """Write the controller file, whole or not at all."""
        write_controller(Path(path), self)


@dataclass(frozen=True, eq=False, repr=False)
class VerdictResult(Result, Verdict):
    """A verdict on the paper's four objectives. It draws how far each finding lies below what is allowed.

    drawn: the plants on which it rests as well, if any were drawn.
    """

    drawn: tuple[DrawnPlants, ...] = ()

    @property
    def holds(self) -> bool:
        return self.outcome is not Outcome.NOT_MET

    def next_step(self) -> str:
        return "" if self.outcome is Outcome.MET else "--full lists every finding, with what helps"

    def facts(self) -> Sequence[Fact]:
        drawn = {"monte_carlo": [plants.document() for plants in self.drawn]} if self.drawn else {}
        return [*verdict_facts(self), *data(drawn)]

    def tables(self) -> Sequence[ResultTable | str]:
        return [*verdict_tables(self), *([_plants_table(self.drawn)] if self.drawn else [])]

    def columns(self) -> Mapping[str, Any]:
        names = ("objective", "channel", "load", "quantity", "value", "allowed", "unit")
        findings = [finding for objective in self.objectives for finding in objective.findings]
        columns = {name: [getattr(finding, name) for finding in findings] for name in names}
        return columns | {"outcome": [str(finding.outcome) for finding in findings]}

    def chart(self) -> Chart:
        findings = [f for objective in self.objectives for f in objective.worst() if f.allowed is not None]
        names = list(dict.fromkeys(finding.channel for finding in findings))
        curves = []
        for name in names:
            of = [finding for finding in reversed(findings) if finding.channel == name and finding.value is not None]
            rows = [f"{finding.objective}: {finding.quantity}" for finding in of]
            missed = [finding.outcome is Outcome.NOT_MET for finding in of]
            curves.append(ChartLine(name, [_excess_db(finding) for finding in of], rows, "o", crossed=missed))
        return Chart("value less what is allowed (dB)", "objective: quantity", curves, upright={"allowed": 0.0})


def _excess_db(finding: Finding) -> float:
    """Return by how many decibels a finding passes what is allowed; a ratio is taken as one of amplitudes."""
    if finding.unit.startswith("dB") or not finding.value or not finding.allowed:
        return finding.excess
    return float(db(finding.value / finding.allowed))


def _plants_table(drawn: Sequence[DrawnPlants]) -> ResultTable:
    names = ("channel", "load", "plants", "from", "unstable", "max|S|", "flatness dB", "felt hum dB SL")
    rows = []
    for plants in drawn:
        cells = [
            plants.quantiles(values) for values in (plants.sensitivity_peak, plants.flatness_db, plants.felt_hum_db_sl)
        ]
        kept = ("—" if np.isnan(values[1]) else f"{values[1]:.2f}/{values[-1]:.2f}" for values in cells)
        unstable = f"{100.0 * plants.unstable:.2g} %"
        rows.append((plants.channel, plants.load, str(plants.count), plants.source, unstable, *kept))
    note = "max|S|, flatness, felt hum: what 95 % of the plants keep / the greatest of all"
    return ResultTable("Monte Carlo", names, tuple(rows), (note,))
