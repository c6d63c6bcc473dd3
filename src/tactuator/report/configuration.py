"""Figures 3, 6 and 8: the mechanism, the loop and the processor, as templates with the numbers of a configuration."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from importlib.resources import files
from string import Template
from textwrap import wrap

import numpy as np

from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.report.figure import ReportFigure, table_of
from tactuator.report.printed import printed_polynomials
from tactuator.signals.exchange import continuous_form
from tactuator.signals.systems import ContinuousSystem, SampledSystem

_PITCH = 13.5
"""From line to line of small print in a box, pixels."""
_LETTERS = {"F": 27, "C": 21, "P": 17}
"""Letters of small print, 6 pixels each, that the boxes of the loop are wide."""


def _diagram(name: str, **words: object) -> str:
    """Return the SVG of a template; a list of words is a line of small print each."""
    template = Template(files("tactuator.report").joinpath("diagrams", f"{name}.svg").read_text("utf-8"))
    return template.substitute(
        {key: _lines(word) if isinstance(word, list | tuple) else escape(f"{word}") for key, word in words.items()}
    )


def _lines(lines: Iterable[str]) -> str:
    return "".join(f'<tspan x="0" dy="{_PITCH}">{escape(line)}</tspan>' for line in lines)


def _as_corners(f: SampledSystem) -> ContinuousSystem:
    """Return the continuous system of the same corner frequencies and the same gain at rest; roots at Nyquist or at the
    origin of z have none.
    """
    zeros, poles = (
        np.log(roots[(np.abs(roots) > 1e-6) & (np.abs(roots + 1.0) > 1e-6)]) * f.rate_hz for roots in (f.zeros, f.poles)
    )
    unscaled = ContinuousSystem(zeros, poles, 1.0)
    return ContinuousSystem(zeros, poles, float(np.real(f.response(0.0) / unscaled.response(0.0))))


def _formula(system: ContinuousSystem, width: int) -> tuple[str, ...]:
    """Return the fraction, or the corner frequencies in lines of so many letters at most."""
    num, den = printed_polynomials(system)
    if max(len(num), len(den)) <= 24:
        return num, "──────────", den
    corners = [np.sort(np.abs(roots)) / (2.0 * np.pi) for roots in (system.zeros, system.poles)]
    zeros, poles = (", ".join(f"{value:.3g}" for value in values) for values in corners)
    lists = (*wrap(f"zeros {zeros} Hz", width), *wrap(f"poles {poles} Hz", width))
    return *lists, f"gain {system.gain:.5g}"


def mechanism_figure(channel: Channel) -> ReportFigure:
    """Draw one channel's mechanism: amplifier to motor, finger, sensor."""
    num, den = printed_polynomials(channel.plant)
    loads = [
        f"{load.name}: {load.mass:g} s² + {load.damping:g} s + {load.stiffness:g}"
        + (f", per {load.per:g}" if load.per else "")
        for load in channel.loads
    ]
    drawing = _diagram(
        "mechanism",
        num=num,
        den=den,
        travel_mm=f"{channel.travel_mm:g}",
        gain=f"{channel.sensor_gain_v_per_mm:.5g}",
        loads=loads or ["no load described"],
    )
    poles = channel.plant.poles / (2.0 * np.pi)
    caption = (
        f"The {channel.name} channel's mechanism. Its poles lie at "
        f"{', '.join(f'{abs(pole):.3g}' for pole in sorted(poles, key=abs))} Hz. The finger is an impedance at the "
        "fingerpad interface, in the plant's own units."
    )
    plant_num, plant_den = channel.plant.polynomials()
    parts = (("num", plant_num), ("den", plant_den))
    rows = [(f"{part}[{index}]", float(value)) for part, values in parts for index, value in enumerate(values)]
    return ReportFigure("fig03", "Motor assembly", caption, drawing, table_of(("coefficient", "value"), rows))


def loop_figure(controller: Controller, channel_name: str) -> ReportFigure:
    """Draw the two-degree-of-freedom loop of a channel with what is in its boxes: C in the continuous form whose
    bilinear transform runs, F, which runs sampled, by the corner frequencies of its roots (log z times the rate).
    """
    rate_hz, designed = controller.rate_hz, controller.channel(channel_name)
    feedback, plant = designed.feedback(rate_hz), controller.display.channel(channel_name).plant
    assert feedback is not None
    systems = {"F": _as_corners(designed.prefilter(rate_hz)), "C": continuous_form(feedback), "P": plant}
    drawing = _diagram(
        "loop", **{letter.lower(): _formula(system, _LETTERS[letter]) for letter, system in systems.items()}
    )
    caption = (
        f"The two-degree-of-freedom controller of the {channel_name} channel, with the identified motor P and the "
        "prefilter F fitted to H/T by its corner frequencies; H = FT, T = CP/(1 + CP)."
    )
    rows = (
        (letter, part, len(values) - 1 - index, float(value))
        for letter, system in systems.items()
        for part, values in zip(("num", "den"), system.polynomials(), strict=True)
        for index, value in enumerate(values)
    )
    table = table_of(("block", "part", "power", "coefficient"), rows)
    return ReportFigure("fig06", "Closed-loop signal block diagram", caption, drawing, table)


def processor_figure(controller: Controller) -> ReportFigure:
    """Draw what runs at every tick, with rate, converters and sections of the controller at hand."""
    converter, designed = controller.display.channels[0].converter, controller.channels[0]
    figures: dict[str, float] = {
        "rate_hz": controller.rate_hz,
        "delay_samples": controller.delay_samples,
        "bits": converter.bits,
        "range_v": converter.range_v,
        "step_v": converter.step_v,
        "prefilter_sections": len(designed.prefilter_sos),
        "feedback_sections": 0 if designed.feedback_sos is None else len(designed.feedback_sos),
    }
    words = {name: f"{value:g}" for name, value in figures.items()}
    channels = len(controller.channels)
    drawing = _diagram("processor", **words, step=f"{converter.step_v * 1e6:.0f}", channels=channels)
    caption = (
        f"The digital environment: {channels} channels at {controller.rate_hz:g} Hz, {converter.bits}-bit converters "
        f"of ±{converter.range_v:g} V, {controller.delay_samples} sample of computing delay."
    )
    table = table_of(("quantity", "value"), figures.items())
    return ReportFigure("fig08", "Digital environment", caption, drawing, table)
