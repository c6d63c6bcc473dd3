"""Figures 3, 6 and 8: the mechanism, the loop and the processor, drawn from the real configuration and its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch

from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.report.plate import BLUE, INK, WIDTH_IN, Plate, table_of
from tactuator.report.tables import printed_polynomials
from tactuator.signals.systems import ContinuousSystem, SampledSystem

Point = tuple[float, float]


@dataclass(frozen=True)
class _Box:
    """A block: its centre, size, name (bold) and lines of small print; the middles of its edges."""

    centre: Point
    name: str
    lines: tuple[str, ...] = ()
    width: float = 1.7
    height: float = 1.0

    @property
    def left(self) -> Point:
        return (self.centre[0] - self.width / 2.0, self.centre[1])

    @property
    def right(self) -> Point:
        return (self.centre[0] + self.width / 2.0, self.centre[1])

    @property
    def top(self) -> Point:
        return (self.centre[0], self.centre[1] + self.height / 2.0)

    @property
    def bottom(self) -> Point:
        return (self.centre[0], self.centre[1] - self.height / 2.0)


def _canvas(width: float, height: float) -> tuple[Figure, Axes]:
    """Return an empty drawing of width by height grid units, without axes."""
    drawing = Figure(figsize=(WIDTH_IN, WIDTH_IN * height / width))
    axes = drawing.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, width)
    axes.set_ylim(0.0, height)
    axes.axis("off")
    return drawing, axes


def _draw_box(axes: Axes, box: _Box) -> None:
    corner = (box.centre[0] - box.width / 2.0, box.centre[1] - box.height / 2.0)
    style = "round,pad=0,rounding_size=0.06"
    axes.add_patch(FancyBboxPatch(corner, box.width, box.height, style, facecolor="#f3f7fb", edgecolor=BLUE))
    pitch = 0.2
    start = box.centre[1] + pitch * len(box.lines) / 2.0
    axes.text(box.centre[0], start, box.name, ha="center", va="center", fontsize=9, weight="bold", color=INK)
    for index, line in enumerate(box.lines, start=1):
        axes.text(box.centre[0], start - pitch * index, line, ha="center", va="center", fontsize=7, color=INK)


def _draw_sum(axes: Axes, centre: Point, signs: str = "") -> None:
    axes.add_patch(Circle(centre, 0.13, facecolor="white", edgecolor=INK, zorder=3))
    axes.text(centre[0] - 0.17, centre[1] - 0.24, signs, ha="center", fontsize=9, color=INK)


def _draw_path(axes: Axes, points: Sequence[Point], label: str = "", above: float = 0.1) -> None:
    for start, end in pairwise(points[:-1]):
        axes.plot([start[0], end[0]], [start[1], end[1]], color=INK, linewidth=1.0, zorder=1)
    arrow = {"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0, "linewidth": 1.0}
    axes.annotate("", points[-1], points[-2], arrowprops=arrow)
    if label:
        x, y = (points[0][0] + points[1][0]) / 2.0, (points[0][1] + points[1][1]) / 2.0
        axes.text(x, y + above, label, ha="center", va="bottom", fontsize=8, style="italic", color=INK)


def _as_corners(f: SampledSystem) -> ContinuousSystem:
    """Return the continuous system of the same corner frequencies and the same gain at rest; roots at Nyquist or at the
    origin of z have none.
    """
    zeros, poles = (
        np.log(roots[(np.abs(roots) > 1e-6) & (np.abs(roots + 1.0) > 1e-6)]) * f.rate_hz for roots in (f.zeros, f.poles)
    )
    unscaled = ContinuousSystem(zeros, poles, 1.0)
    return ContinuousSystem(zeros, poles, float(np.real(f.response(0.0) / unscaled.response(0.0))))


def _formula(system: ContinuousSystem) -> tuple[str, ...]:
    num, den = printed_polynomials(system)
    if max(len(num), len(den)) <= 24:
        return num, "──────────", den
    corners = [np.sort(np.abs(roots)) / (2.0 * np.pi) for roots in (system.zeros, system.poles)]
    zeros, poles = (", ".join(f"{value:.3g}" for value in values) for values in corners)
    return f"zeros {zeros} Hz", f"poles {poles} Hz", f"gain {system.gain:.5g}"


def mechanism_plate(channel: Channel) -> Plate:
    """Draw one channel's mechanism: amplifier to motor, finger, sensor."""
    num, den = printed_polynomials(channel.plant)
    loads = [f"{load.name}: {load.mass:g} s² + {load.damping:g} s + {load.stiffness:g}" for load in channel.loads]
    drawing, axes = _canvas(9.0, 3.4)
    motor = _Box((3.0, 1.9), "motor assembly", ("P(s) =", num, "────────────", den), 2.3, 1.5)
    pin = _Box((5.9, 1.9), "fingerpad interface", (f"travel ±{channel.travel_mm:g} mm",), 2.15)
    sensor = _Box((8.05, 1.9), "position sensor", (f"{channel.sensor_gain_v_per_mm:.5g} V/mm",), 1.7)
    finger = _Box((5.9, 0.55), "finger", tuple(loads) or ("no load described",), 2.9, 0.8)
    for box in (motor, pin, sensor, finger):
        _draw_box(axes, box)
    _draw_path(axes, [(0.5, 1.9), motor.left], "command u (V)")
    _draw_path(axes, [motor.right, pin.left], "angle")
    _draw_path(axes, [pin.right, sensor.left])
    _draw_path(axes, [finger.top, pin.bottom])
    _draw_path(axes, [sensor.top, (8.05, 3.1)])
    axes.text(7.95, 2.85, "position y (V)", fontsize=8, style="italic", ha="right", va="center")
    poles = channel.plant.poles / (2.0 * np.pi)
    caption = (
        f"The {channel.name} channel's mechanism. Its poles lie at "
        f"{', '.join(f'{abs(pole):.3g}' for pole in sorted(poles, key=abs))} Hz. The finger is an impedance at the "
        "fingerpad interface, in the plant's own units."
    )
    plant_num, plant_den = channel.plant.polynomials()
    parts = (("num", plant_num), ("den", plant_den))
    rows = [(f"{part}[{index}]", float(value)) for part, values in parts for index, value in enumerate(values)]
    return Plate("fig03", "Motor assembly", caption, drawing, table_of(("coefficient", "value"), rows))


def loop_plate(channel: Channel, c: ContinuousSystem, f: SampledSystem) -> Plate:
    """Draw the two-degree-of-freedom loop of `channel`'s plant, with what stands in its boxes: F as it runs, sampled,
    is shown by the corner frequencies of its roots (log z times the rate).
    """
    drawing, axes = _canvas(10.0, 3.6)
    boxes = {}
    for x, width, letter, system in (
        (1.9, 2.7, "F(z)", _as_corners(f)),
        (5.1, 2.1, "C(s)", c),
        (7.7, 1.7, "P(s)", channel.plant),
    ):
        boxes[letter] = _Box((x, 2.3), letter, _formula(system), width, 1.15)
        _draw_box(axes, boxes[letter])
    before, after, noise = (3.6, 2.3), (9.1, 2.3), (6.5, 0.7)
    for centre, signs in ((before, "−"), (after, "+"), (noise, "+")):
        _draw_sum(axes, centre, signs)
    _draw_path(axes, [(0.2, 2.3), boxes["F(z)"].left], "r")
    _draw_path(axes, [boxes["F(z)"].right, (before[0] - 0.13, 2.3)])
    _draw_path(axes, [(before[0] + 0.13, 2.3), boxes["C(s)"].left], "e")
    _draw_path(axes, [boxes["C(s)"].right, boxes["P(s)"].left], "u")
    _draw_path(axes, [boxes["P(s)"].right, (after[0] - 0.13, 2.3)])
    _draw_path(axes, [(9.1, 3.3), (9.1, 2.43)])
    axes.text(9.0, 3.2, "dₒ (finger)", fontsize=8, style="italic", ha="right", va="center")
    _draw_path(axes, [(after[0] + 0.13, 2.3), (9.95, 2.3)], "y")
    _draw_path(axes, [(9.55, 2.3), (9.55, 0.7), (noise[0] + 0.13, 0.7)])
    _draw_path(axes, [(6.5, 0.15), (6.5, 0.57)])
    axes.text(6.6, 0.2, "n (hum, noise)", fontsize=8, style="italic", ha="left", va="center")
    _draw_path(axes, [(noise[0] - 0.13, 0.7), (3.6, 0.7), (3.6, 2.17)])
    caption = (
        f"The two-degree-of-freedom controller of the {channel.name} channel: the paper's C, the plant of the display "
        "file, and the prefilter fitted to H/T, shown by its corner frequencies; H = FT, T = CP/(1 + CP)."
    )
    rows = (
        (letter, part, len(values) - 1 - index, float(value))
        for letter, system in (("F", _as_corners(f)), ("C", c), ("P", channel.plant))
        for part, values in zip(("num", "den"), system.polynomials(), strict=True)
        for index, value in enumerate(values)
    )
    table = table_of(("block", "part", "power", "coefficient"), rows)
    return Plate("fig06", "Closed-loop signal block diagram", caption, drawing, table)


def processor_plate(controller: Controller) -> Plate:
    """Draw what runs at every tick, with rate, converters and sections of the controller at hand."""
    channel = controller.display.channels[0]
    designed = controller.channels[0]
    bits, volts = channel.converter.bits, channel.converter.range_v
    feedback = 0 if designed.feedback_sos is None else len(designed.feedback_sos)
    drawing, axes = _canvas(10.0, 3.5)
    converter = (f"{bits} bits, ±{volts:g} V", f"step {channel.converter.step_v * 1e6:.0f} µV")
    reference = _Box((1.1, 2.5), "reference", ("threshold units", "stream or stimulus"), 1.8)
    prefilter = _Box((3.4, 2.5), "prefilter F", (f"{len(designed.prefilter_sos)} sections, float32",), 1.8)
    feedback_box = _Box((5.9, 2.5), "feedback C", (f"{feedback} sections, float32", "anti-windup"), 1.9)
    output = _Box((8.6, 2.5), "D/A", (*converter, f"{controller.delay_samples} sample later"), 1.8)
    display = _Box((8.6, 0.75), "display", (f"{len(controller.channels)} channels",), 1.8)
    sensor = _Box((5.9, 0.75), "A/D", converter, 1.9)
    for box in (reference, prefilter, feedback_box, output, display, sensor):
        _draw_box(axes, box)
    _draw_path(axes, [reference.right, prefilter.left], "r")
    _draw_path(axes, [prefilter.right, feedback_box.left], "v")
    _draw_path(axes, [feedback_box.right, output.left], "u")
    _draw_path(axes, [output.bottom, display.top])
    _draw_path(axes, [display.left, sensor.right], "y")
    _draw_path(axes, [sensor.top, feedback_box.bottom])
    axes.text(3.4, 1.5, f"timer interrupt, {controller.rate_hz:g} Hz", fontsize=8, ha="center", style="italic")
    caption = (
        f"The digital environment: {len(controller.channels)} channels at {controller.rate_hz:g} Hz, "
        f"{bits}-bit converters of ±{volts:g} V, {controller.delay_samples} sample of computing delay."
    )
    figures: dict[str, float] = {
        "rate_hz": controller.rate_hz,
        "delay_samples": controller.delay_samples,
        "bits": bits,
        "range_v": volts,
        "step_v": channel.converter.step_v,
        "prefilter_sections": len(designed.prefilter_sos),
        "feedback_sections": feedback,
    }
    table = table_of(("quantity", "value"), figures.items())
    return Plate("fig08", "Digital environment", caption, drawing, table)
