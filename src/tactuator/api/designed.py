"""A controller with its verdict, response and file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from tactuator import report
from tactuator.api.parameters import Place
from tactuator.arrays import ComplexArray, frequencies
from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.measure.error import expected_response
from tactuator.model.controller import Controller
from tactuator.model.description import Display
from tactuator.model.verdict import Verdict
from tactuator.parameters import checked
from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.report.printed import design_rows, printed_factors
from tactuator.result import FREQUENCY, Chart, ChartLine, Fact, Result, ResultTable, found, in_a_line
from tactuator.signals.decibels import db
from tactuator.signals.discretise import discretise
from tactuator.signals.exchange import continuous_form
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.loop_figures import Margins, margins
from tactuator.synthesis.objectives import whole_verdict


class ControllerResult(Result, Controller):
    """A controller. It draws what its model expects to be felt, less what is asked, free and under each load."""

    @classmethod
    def of(cls, controller: Controller) -> Self:
        """Return a controller with its verdict, response and file, which rooms below the model do not know."""
        return cls(**{field.name: getattr(controller, field.name) for field in fields(controller)})

    @checked
    def on(self, display: Display) -> Self:
        """Return the controller on another display. Raises BadInput for one that it cannot run."""
        self.require_runs(display)
        return self.of(replace(self, display=display))

    @cached_property
    def verdict(self) -> Verdict:
        """Return the verdict on the objectives and on building an image."""
        return whole_verdict(self)

    @property
    def holds(self) -> bool:
        return self.verdict.holds

    def notices(self) -> Sequence[str]:
        channels = self.display.channels
        given = [(channel.name, channel.recorded.remarks) for channel in channels if channel.recorded is not None]
        remarks = [f"{name}: the plant: {remark}" for name, of_plant in given for remark in of_plant]
        return [
            *(notice for channel in channels for notice in channel.contact_notices()),
            *remarks,
            *self.verdict.notices(),
        ]

    def next_step(self) -> str:
        return "tactuator build" if self.holds else "--full lists every finding, with what helps"

    def __repr__(self) -> str:
        """Return rate and channels in a line; the verdict takes a while."""
        return in_a_line("Controller", {fact.words: fact.text for fact in self._figures() if fact.words})

    def facts(self) -> Sequence[Fact]:
        return [*self.verdict.told(), *self._figures(), Fact("verdict", self.verdict.document())]

    def _figures(self) -> list[Fact]:
        facts = [found("rate", self.rate_hz, "Hz")]
        for channel in self.channels:
            margins, fit = channel.report.get("margins") or {}, channel.report.get("prefilter") or {}
            degrees = margins.get("phase_margin_deg")  # None where the gain never passes one
            margin = "" if degrees is None else f"phase margin {degrees:.1f}°, "
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
            *self.verdict.tables(),
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
        tolerance, label = self.display.objectives.flatness_db, "level error, by the model (dB)"
        return Chart(FREQUENCY, label, curves, True, (0.0,), tolerance, AMPLITUDE_JND_DB)

    @checked
    def response(self, channel: str, frequency_hz: ArrayLike, load: str | None = None) -> ComplexArray:
        """Return the volts of y per threshold unit that the model expects of a channel, (m,); load: None for free."""
        return expected_response(self, channel, load, frequencies(frequency_hz))

    @checked
    def loop(self, channel: str, load: str | None = None) -> FeedbackLoop:
        """Return the sampled feedback loop of a channel, free or under a load; computing delay and hold included.

        Raises BadInput for a channel without a loop.
        """
        described = self.display.channel(channel)
        feedback = self.channel(channel).feedback(self.rate_hz)
        if feedback is None:
            raise BadInput(f"channel {channel!r} has no loop", "one that has")
        plant = described.loaded_plant(None if load is None else described.load(load))
        return FeedbackLoop(feedback, discretise(plant, self.rate_hz, "zoh", self.display.delay_samples))

    @checked
    def margins(self, channel: str, load: str | None = None) -> Margins:
        """Return crossover, margins and peaks of a channel's loop. Raises BadInput for a channel without a loop."""
        return margins(self.loop(channel, load))

    @checked
    def bode(self, channel: str) -> Any:
        """Return a matplotlib figure of magnitude and phase of a channel's P, C, C P and F."""
        return report.design_figures.drawn(self, channel, "bode")

    @checked
    def step(self, channel: str) -> Any:
        """Return a matplotlib figure: the step of a channel's closed loop, by load. Raises BadInput without a loop."""
        self.loop(channel)
        return report.design_figures.drawn(self, channel, "step")

    @checked
    def nichols(self, channel: str) -> Any:
        """Return a matplotlib figure: a channel's open loop on the Nichols chart. Raises BadInput without a loop."""
        self.loop(channel)
        return report.design_figures.drawn(self, channel, "nichols")

    @checked
    def write(self, path: Place) -> None:
        """Write the controller file, whole or not at all."""
        write_controller(Path(path), self)
