"""Figures of a controller: Bode, sensitivity, headroom, landing, prefilter, word length, and a design's whole set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MultipleLocator, NullFormatter

from tactuator.arrays import FloatArray
from tactuator.measure.adaptive import LANDS_S, LIFTED_S, Landing, landing
from tactuator.model.controller import Controller
from tactuator.model.requirements import FeedbackRequirements
from tactuator.report.felt import equality_plate
from tactuator.report.nichols import NicholsInput, nichols_plate
from tactuator.report.plate import Plate, save_plates
from tactuator.report.style import BLUE, CYCLE, FAINT, GREEN, INK, ORANGE, RED, figure, frequency_axis, legend
from tactuator.signals.decibels import db
from tactuator.signals.loop import FeedbackLoop, System, TwoDegreeLoop
from tactuator.synthesis.design import Headroom, headroom, headroom_grid_hz
from tactuator.synthesis.family import UNLOADED, plant_family
from tactuator.synthesis.touch import fed_response
from tactuator.wordlength.bits import MOST_BITS, BitsNeeded


def bode_plate(
    systems: Mapping[str, System], band_hz: tuple[float, float], name: str = "bode", title: str = "Bode diagram"
) -> Plate:
    """Draw magnitude (dB) and phase (degrees, continuous) of each system by its label, over band_hz."""
    frequency = np.geomspace(*band_hz, 600)
    made, (upper, lower) = figure(2, 1, height_in=5.0, sharex=True)
    table: dict[str, list[float]] = {"frequency_hz": frequency.tolist()}
    for index, (label, system) in enumerate(systems.items()):
        response = system.response(frequency)
        level, phase = db(response), np.degrees(np.unwrap(np.angle(response)))
        phase = phase - 360.0 * np.ceil((phase[0] - 180.0) / 360.0)
        style = {"color": CYCLE[index % len(CYCLE)], "linestyle": ("-", "--", "-.", ":")[index % 4]}
        upper.plot(frequency, level, label=label, **style)
        lower.plot(frequency, phase, **style)
        table[f"{label} dB"], table[f"{label} deg"] = level.tolist(), phase.tolist()
    upper.set_ylabel("magnitude (dB)", fontsize=9)
    lower.set_ylabel("phase (degrees)", fontsize=9)
    lower.yaxis.set_major_locator(MultipleLocator(90.0))
    frequency_axis(lower, *band_hz)
    legend(upper)
    caption = f"Magnitude and phase of {', '.join(systems)}."
    return Plate(name, title, caption, made, table)


_LIMIT_COLOURS = {"comfort": GREEN, "command": RED, "travel": BLUE}


def lowest(rooms: Mapping[str, Headroom]) -> dict[str, Headroom]:
    """Return for each load the lowest headroom of all its models, frequency by frequency."""
    found = {}
    for load, names in _by_load(list(rooms)).items():
        levels = np.array([rooms[name].level_db_sl for name in names])
        which, columns = np.argmin(levels, axis=0), range(levels.shape[1])
        binding = tuple(rooms[names[row]].binding[column] for row, column in zip(which, columns, strict=True))
        found[load] = Headroom(rooms[names[0]].frequency_hz, levels.min(axis=0), binding)
    return found


def headroom_plate(rooms: Mapping[str, Headroom], name: str = "headroom", title: str = "Headroom") -> Plate:
    """Draw the greatest sinusoidal reference (dB SL) against frequency for each load; colour: the limit that binds."""
    made, axes = figure(height_in=3.6)
    table: dict[str, list[object]] = {"load": [], "frequency_hz": [], "level_db_sl": [], "binding": []}
    seen: set[str] = set()
    for index, (load, room) in enumerate(rooms.items()):
        style = ("-", "--", "-.", ":")[index % 4]
        words = "no load" if load == "none" else load
        axes.plot(room.frequency_hz, room.level_db_sl, color=INK, linewidth=0.9, linestyle=style, label=words, zorder=2)
        for limit, colour in _LIMIT_COLOURS.items():
            bound = np.array([one == limit for one in room.binding])
            if np.any(bound):
                label = None if limit in seen else f"stopped by {limit}"
                seen.add(limit)
                axes.plot(
                    room.frequency_hz[bound], room.level_db_sl[bound], "o", color=colour, markersize=4, label=label
                )
        table["load"] += [load] * room.frequency_hz.size
        table["frequency_hz"] += room.frequency_hz.tolist()
        table["level_db_sl"] += room.level_db_sl.tolist()
        table["binding"] += list(room.binding)
    lowest = min(float(room.level_db_sl.min()) for room in rooms.values())
    axes.set_ylim(min(5.0 * np.floor((lowest - 8.0) / 5.0), 40.0), axes.get_ylim()[1] + 1.0)
    first = next(iter(rooms.values())).frequency_hz
    frequency_axis(axes, float(first[0]), float(first[-1]))
    axes.set_ylabel("greatest level (dB SL)", fontsize=9)
    legend(axes, loc="lower left", ncols=2)
    caption = (
        "The greatest level of one sinusoid before the mechanism's travel, the command's range or comfort stops it; "
        "the colour of a point says which."
    )
    return Plate(name, title, caption, made, table)


def landing_plate(shown: Landing, name: str, title: str) -> Plate:
    """Draw the change of the felt level against time, adaptive over fixed, and the band of 1 dB about none."""
    made, axes = figure(height_in=3.2)
    axes.axvspan(LANDS_S, LIFTED_S, color=FAINT, alpha=0.3, linewidth=0.0)
    axes.axhspan(-1.0, 1.0, color=BLUE, alpha=0.08, linewidth=0.0)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.plot(shown.time_s, shown.fixed_db, color=ORANGE, linewidth=1.2, linestyle="--", label="fixed")
    axes.plot(shown.time_s, shown.adaptive_db, color=BLUE, linewidth=1.4, label="adaptive")
    reach = max(1.5, 1.15 * float(np.max(np.abs([shown.fixed_db, shown.adaptive_db]))))
    axes.set_ylim(-reach, reach)
    axes.set_xlim(float(shown.time_s[0]), float(shown.time_s[-1]))
    axes.annotate("touched", (LANDS_S, -reach), (4, 4), textcoords="offset points", fontsize=8, color=INK)
    axes.set_xlabel("time (s)", fontsize=9)
    axes.set_ylabel("change of the felt level (dB)", fontsize=9)
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    caption = (
        f"Felt level of {shown.channel} in windows of 0.1 s, against the same run free, while the load {shown.load!r} "
        f"lands and is lifted (grey): five tones at 30 dB SL on the simulated display with hum, noise, friction and "
        f"converters. Adaptive: {_range(shown.adaptive_db)}; fixed: {_range(shown.fixed_db)}. Shaded: within 1 dB."
    )
    table = {
        "time_s": shown.time_s.tolist(),
        "adaptive_db": shown.adaptive_db.tolist(),
        "fixed_db": shown.fixed_db.tolist(),
    }
    return Plate(name, title, caption, made, table)


def _range(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    return f"{float(np.min(values)):+.2f} to {float(np.max(values)):+.2f} dB"


def sensitivity_plate(
    loops: Mapping[str, FeedbackLoop],
    requirements: FeedbackRequirements,
    band_hz: tuple[float, float],
    name: str = "sensitivity",
    title: str = "Sensitivity",
) -> Plate:
    """Draw |S| and |T| in dB for each load, the limits as bars (the curves must stay below them).

    loops: by the name of their plant; the models of one load are one envelope around its nominal line.
    """
    frequency = np.geomspace(*band_hz, 600)
    made, axes = figure(height_in=4.2)
    table: dict[str, list[float]] = {"frequency_hz": frequency.tolist()}
    for index, (load, names) in enumerate(_by_load(list(loops)).items()):
        style = ("-", "--", "-.", ":")[index % 4]
        words = "no load" if load == "none" else load
        for symbol, colour in (("S", BLUE), ("T", RED)):
            levels = np.array([_level_db(loops[name], symbol, frequency) for name in names])
            axes.plot(frequency, levels[0], color=colour, linestyle=style, label=f"|{symbol}|, {words}")
            table[f"{symbol} {load} dB"] = levels[0].tolist()
            if len(names) > 1:
                low, high = levels.min(axis=0), levels.max(axis=0)
                axes.fill_between(frequency, low, high, color=colour, alpha=0.18, linewidth=0.0, zorder=1)
                table |= {f"{symbol} {load} least dB": low.tolist(), f"{symbol} {load} greatest dB": high.tolist()}
    axes.axhline(0.0, color=INK, linewidth=0.7)
    _limits(axes, requirements)
    frequency_axis(axes, *band_hz)
    axes.set_ylim(bottom=max(axes.get_ylim()[0], -60.0))
    axes.set_ylabel("magnitude (dB)", fontsize=9)
    legend(axes, loc="lower center", ncols=2)
    caption = "Sensitivity S and complementary sensitivity T; bars: the limits of the display file, to stay below."
    if len(loops) > len(_by_load(list(loops))):
        caption += " Shaded: every model of the family."
    return Plate(name, title, caption, made, table)


def _level_db(loop: FeedbackLoop, symbol: str, frequency_hz: FloatArray) -> FloatArray:
    return db(loop.sensitivity(frequency_hz) if symbol == "S" else loop.complementary(frequency_hz))


def _limits(axes: Axes, requirements: FeedbackRequirements) -> None:
    bars = [
        *zip(requirements.rejection_hz, requirements.rejection_max_db, strict=True),
        *zip(requirements.mains_hz, requirements.mains_max_db, strict=True),
    ]
    for frequency, limit in bars:
        axes.plot(
            [frequency / 1.12, frequency * 1.12], [limit, limit], color=ORANGE, linewidth=3.0, solid_capstyle="butt"
        )
    if requirements.sensitivity_peak is not None:
        level = float(db(requirements.sensitivity_peak))
        axes.axhline(level, color=ORANGE, linewidth=1.0, linestyle="--", label="limits")
    elif bars:
        axes.plot([], [], color=ORANGE, linewidth=3.0, label="limits")


Errors = Mapping[str, tuple[FloatArray, FloatArray]]
"""By name: frequency_hz (n,) and the error of |H| there, dB (n,)."""


def prefilter_plate(errors: Errors, tolerance_db: float, name: str = "prefilter") -> Plate:
    """Draw the error of |H| against the curve for every prefilter, with the tolerance as a band."""
    made, axes = figure(height_in=3.4)
    low = min(float(frequency.min()) for frequency, _ in errors.values())
    high = max(float(frequency.max()) for frequency, _ in errors.values())
    axes.axhspan(-tolerance_db, tolerance_db, color=FAINT, alpha=0.3, linewidth=0)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    table: dict[str, list[object]] = {"prefilter": [], "frequency_hz": [], "error_db": []}
    for colour, (label, (frequency, error)) in zip(CYCLE, errors.items(), strict=False):
        worst = float(np.max(np.abs(error)))
        axes.plot(frequency, error, color=colour, linewidth=1.3, label=f"{label}: at most {worst:.2f} dB")
        table["prefilter"] += [label] * frequency.size
        table["frequency_hz"] += frequency.tolist()
        table["error_db"] += error.tolist()
    frequency_axis(axes, low, high)
    axes.set_ylabel("|H| less curve (dB)", fontsize=9)
    legend(axes, loc="lower left")
    caption = f"Error of the response against the threshold curve; the band is the tolerance of ±{tolerance_db:g} dB."
    return Plate(name, "Prefilters against the curve", caption, made, table)


_WORDS = {"direct": "one direct form", "sections": "second-order sections", "delta": "delta sections"}
_FORM_COLOURS = {"direct": BLUE, "sections": RED, "delta": GREEN}


def resolution_plate(
    needed: Mapping[str, Mapping[str, Mapping[float, BitsNeeded]]],
    name: str = "resolution",
    whose: str = "the paper's filters",
    band: str = "0.1-300 Hz",
) -> Plate:
    """Draw a panel for each filter: bits to keep 0.1 dB (solid) and to be stable (dashed). needed: filter ("prefilter
    F", ...) to form to rate_hz to bits. whose, band: as the caption tells it.
    """
    made, axes = figure(1, len(needed), height_in=3.6, sharey=True, squeeze=False)
    for panel, (filter_name, forms) in zip(axes[0], needed.items(), strict=True):
        _draw_resolution(panel, forms)
        panel.set_title(filter_name, fontsize=9)
        panel.axhline(14.0, color=INK, linewidth=0.8, linestyle=":")
    beside = ("axes fraction", "data")
    axes[0, -1].annotate("16-bit\nwords", (1.0, 14.0), (3, 0), beside, "offset points", fontsize=7, va="center")
    axes[0, 0].set_ylabel("fractional bits needed", fontsize=9)
    axes[0, 0].yaxis.set_major_locator(MultipleLocator(5))
    axes[0, 0].set_ylim(-1.5, None)
    forms_shown = dict.fromkeys(form for forms in needed.values() for form in forms)
    keys = [Line2D([], [], color=_FORM_COLOURS[form], label=_WORDS[form]) for form in forms_shown]
    keys += [
        Line2D([], [], color=INK, marker="o", markersize=4, label="within 0.1 dB"),
        Line2D([], [], color=INK, marker="o", markersize=3, fillstyle="none", linestyle="--", label="stable"),
    ]
    made.legend(handles=keys, loc="outside lower center", ncols=5, fontsize=7, frameon=False, columnspacing=1.2)
    caption = (
        f"Fractional bits that the coefficients of {whose} need so that the response stays within 0.1 dB over {band} "
        "(solid) and the filter, or its loop, stays stable (dashed). 16-bit words have 14 for a section's denominator. "
        f"A line ends where {MOST_BITS} bits are not enough."
    )
    return Plate(name, "Coefficient resolution against sampling rate", caption, made, _resolution_table(needed))


def _draw_resolution(panel: Axes, forms: Mapping[str, Mapping[float, BitsNeeded]]) -> None:
    rates: Sequence[float] = []
    for form, by_rate in forms.items():
        rates = list(by_rate)
        accurate, stable = (
            [getattr(bits, what) if getattr(bits, what) <= MOST_BITS else np.nan for bits in by_rate.values()]
            for what in ("accurate", "stable")
        )
        panel.plot(rates, accurate, "o-", color=_FORM_COLOURS[form], markersize=4)
        panel.plot(rates, stable, "o--", color=_FORM_COLOURS[form], markersize=3, linewidth=0.9, fillstyle="none")
    panel.set_xscale("log", base=2)
    panel.xaxis.set_major_locator(FixedLocator(rates))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 1000:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_xlabel("sampling rate (kHz)", fontsize=9)


def _resolution_table(needed: Mapping[str, Mapping[str, Mapping[float, BitsNeeded]]]) -> dict[str, list[object]]:
    rows = [
        (filter_name, form, rate, bits.stable, bits.accurate)
        for filter_name, forms in needed.items()
        for form, by_rate in forms.items()
        for rate, bits in by_rate.items()
    ]
    columns = ("filter", "form", "rate_hz", "stable_bits", "accurate_bits")
    return {name: list(cells) for name, cells in zip(columns, zip(*rows, strict=True), strict=True)}


def design_plates(controller: Controller, channel_name: str) -> tuple[Plate, ...]:
    """Return the figures of one channel, each named KIND-CHANNEL; of an adaptive one, how a finger lands as well."""
    display = controller.display
    channel, own = display.channel(channel_name), controller.channel(channel_name)
    family = plant_family(channel, display.rate_hz, display.delay_samples)
    prefilter, feedback = own.prefilter(display.rate_hz), own.feedback(display.rate_hz)
    loops = {one.name: TwoDegreeLoop(prefilter, feedback, one.sampled) for one in family}
    closed = {name: loop.feedback for name, loop in loops.items() if loop.feedback is not None}
    low, high = channel.threshold.band_hz
    wide = (low / 2.0, min(2.0 * high, 0.45 * display.rate_hz))
    plates = []
    if feedback is not None:
        nominal = closed[UNLOADED]
        others = [loop for name, loop in closed.items() if name != UNLOADED]
        shown = NicholsInput(nominal, channel.plant, None, others, wide)
        plates.append(nichols_plate(shown, f"nichols-{channel_name}", f"Nichols chart, {channel_name}"))
        systems = {"P": family[0].sampled, "C": feedback, "C P": nominal.open_loop, "F": prefilter}
        plates.append(bode_plate(systems, wide, f"bode-{channel_name}", f"Bode diagram, {channel_name}"))
        limits = channel.feedback
        title = f"Sensitivity, {channel_name}"
        plates.append(sensitivity_plate(closed, limits, wide, f"sensitivity-{channel_name}", title))
    else:
        open_systems = {"P": family[0].sampled, "F": prefilter}
        plates.append(bode_plate(open_systems, wide, f"bode-{channel_name}", f"Bode diagram, {channel_name}"))
    grid = headroom_grid_hz(channel)
    comfort = display.objectives.comfort_db_sl
    rooms = {}
    for one in family:
        loop = loops[one.name]
        answer = fed_response(own.feed_forward, channel, loops[UNLOADED], loop, one.load, grid, display.rate_hz)
        rooms[one.name] = headroom(channel, loop, grid, comfort, answer)
    plates.append(headroom_plate(lowest(rooms), f"headroom-{channel_name}", f"Headroom, {channel_name}"))
    fine = np.geomspace(low, high, 400)
    response = loops[UNLOADED].position_response(fine)
    title = f"Response + sensitivity = constant, {channel_name}"
    plates.append(equality_plate(channel, fine, response, name=f"equality-{channel_name}", title=title))
    if own.feed_forward is not None:
        shown_landing = landing(controller, channel_name)
        plates.append(landing_plate(shown_landing, f"landing-{channel_name}", f"A finger lands, {channel_name}"))
    return tuple(plates)


def save_design_plates(controller: Controller, folder: Path) -> None:
    """Write every channel's figures (SVG, with their numbers as CSV) into `folder`, whole or not at all.

    Raises BadInput for a folder that holds anything else.
    """
    save_plates([plate for one in controller.channels for plate in design_plates(controller, one.name)], folder)


def _by_load(names: Sequence[str]) -> dict[str, list[str]]:
    """Return names of a family's members (`finger`, `finger, model 2`) by their load, the nominal model first."""
    loads: dict[str, list[str]] = {}
    for name in names:
        loads.setdefault(name.split(", model ")[0], []).append(name)
    return loads
