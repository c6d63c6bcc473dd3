"""Tables as texts: a controller's figures, a verdict's findings, an identification, transfer functions as printed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.by_response import ResponseFit
from tactuator.identification.result import Identification
from tactuator.model.controller import ChannelController
from tactuator.model.plant_model import PlantModel
from tactuator.model.verdict import Finding
from tactuator.signals.systems import ContinuousSystem
from tactuator.table import ResultTable

FINDING_COLUMNS = ("objective", "channel", "outcome", "found", "allowed", "frequency", "load")
_ROWS: Mapping[str, tuple[str, ...]] = {
    "crossover (Hz)": ("margins", "crossover_hz"),
    "phase margin (deg)": ("margins", "phase_margin_deg"),
    "gain margin (dB)": ("margins", "gain_margin_db"),
    "unstable below this gain (1: as designed)": ("margins", "least_gain"),
    "max|S|": ("margins", "sensitivity_peak"),
    "max|T|": ("margins", "complementary_peak"),
    "disk margin": ("margins", "disk_margin"),
    "delay margin (samples)": ("margins", "delay_margin_samples"),
    "command noise gain": ("margins", "command_noise_gain"),
    "mean |S| over the rejection band (dB)": ("rejection_db", "mean"),
    "prefilter: poles": ("prefilter", "poles"),
    "prefilter: greatest error (dB)": ("prefilter", "max_error_db"),
    "prefilter: rms error (dB)": ("prefilter", "rms_error_db"),
}


def design_rows(channels: Sequence[ChannelController]) -> Iterator[tuple[str, ...]]:
    """Yield the figures of a design, the worst over the loads: their name, then a cell for each channel."""
    for words, keys in _ROWS.items():
        yield words, *(_cell(_found(channel.report, keys)) for channel in channels)
    lines_hz = sorted({key for channel in channels for key in channel.report.get("mains_db", {})}, key=float)
    for key in lines_hz:
        yield f"|T| at {key} Hz (dB)", *(_cell(_found(channel.report, ("mains_db", key))) for channel in channels)


def finding_row(finding: Finding) -> tuple[str, ...]:
    """Return a finding as the cells of `FINDING_COLUMNS`."""
    unit = f" {finding.unit}" if finding.unit else ""
    value = finding.quantity if finding.value is None else f"{finding.quantity} {finding.figure}"
    allowed = "" if finding.allowed is None else f"{'±' if finding.side else ''}{finding.allowed:g}{unit}"
    at = "" if finding.frequency_hz is None else f"{finding.frequency_hz:.4g} Hz"
    return finding.objective, finding.channel, finding.outcome.value, value, allowed, at, load_words(finding.load)


def load_words(name: str) -> str:
    """Return a load, or a plant of the family under it (`finger, model 2`), as a person reads it."""
    load, _, model = name.partition(", model ")
    words = "free" if load == "none" else load
    return f"{words}, plant {model} of the family" if model else words


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


def _found(report: Any, keys: tuple[str, ...]) -> Any:
    for key in keys:
        report = report.get(key) if report is not None else None
    return report


def _cell(value: Any) -> str:
    if value is None:
        return "—"
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def with_error(value: float, error: float) -> tuple[str, str]:
    """Return a value to the last digit that its error leaves, and the error to two digits."""
    if not (math.isfinite(value) and math.isfinite(error) and error > 0.0):
        return f"{value:.6g}", f"{error:.2g}"
    decimals = 1 - math.floor(math.log10(error))
    if not -2 <= decimals <= 6:  # very large and very small numbers keep an exponent
        digits = max(1, math.floor(math.log10(abs(value) or error)) + decimals + 1)
        return f"{value:.{digits}g}", f"{error:.2g}"
    decimals = max(decimals, 0)
    return f"{value:.{decimals}f}", f"{error:.{decimals}f}"


_BETWEEN = {
    "zero-order": "held constant (zero-order hold)",
    "first-order": "joined by straight lines (first-order hold)",
    "band-limited": "smooth, through a filter (band-limited)",
}
_SAID_BY = {"data": "as the data show", "file": "as the record's file says", "asked": "as you said"}


def identification_rows(fit: Identification, about: Mapping[str, str]) -> Iterator[tuple[str, str, str]]:
    """Yield the rows of the table: what it is, its value, its 95 % interval (or nothing)."""
    model, confidence = fit.model, fit.model.confidence()
    for name, values, first in (("numerator", model.num, 0), ("denominator", model.den, 1)):
        top = values.size - 1
        for k in range(first, values.size):
            error = confidence[f"{name[:3]}_s{top - k}"]
            yield f"{name}, s^{top - k}", *with_error(float(values[k]), error)
    for known in fit.fixed:
        yield f"fixed: {known.fixed.name}", str(known.fixed).partition("=")[2], known.beside
    yield "dead time (ms)", *with_error(1e3 * model.delay_s, 1e3 * confidence["delay_s"])
    yield "poles (Hz)", ", ".join(f"{pole:.4g}" for pole in fit.poles_hz), ""
    for mode in fit.resonances:
        name = f"resonance at {mode.frequency_hz:.4g} Hz"
        yield name, f"damping ratio {mode.damping_ratio:.3g}, Q {mode.q:.3g}", ""
    for words, value in _circumstances(fit, about):
        yield words, value, ""
    command, position = f"{model.command_unit} of command".strip(), f"{model.position_unit} of position".strip()
    for name, known_as in zip(("mass", "viscous damping"), fit.mass_and_viscous or (), strict=False):
        yield f"{name} ({command}, {position}, s)", *with_error(*known_as)
    if fit.friction is not None:
        level = with_error(fit.friction.coulomb, fit.friction.confidence)
        yield f"Coulomb friction ({command})", *level
        distance = fit.friction.presliding
        yield f"presliding distance ({position})", "cannot tell" if distance is None else f"{distance:.3g}", ""


def _circumstances(fit: Identification, about: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    model = fit.model
    sure = "" if fit.between.certain else "; not certain, so the band covers the other as well"
    yield "command between samples", f"{_BETWEEN[fit.between.hold]}, {_SAID_BY[fit.between.source]}{sure}"
    yield "feedback during the recording", {True: "yes", False: "no", None: "unknown"}[fit.tests.feedback]
    if {"input", "output"} <= set(about):
        yield "columns", f"{about['input']} -> {about['output']}"
    for name, unit in (("command", model.command_unit), ("position", model.position_unit)):
        if (half := model.record.get(f"{name}_half_span")) is not None:
            yield f"{name} amplitude (half its span)", f"{half:.4g} {unit or '(no unit given)'}"
    yield "order of persistent excitation", str(fit.excitation.order)
    if model.valid_hz is not None:
        yield "the model is valid over (Hz)", f"{model.valid_hz[0]:.4g} to {model.valid_hz[1]:.4g}"
    yield "fit of the simulated position (%)", f"{fit.fit_percent:.2f}"
    for unseen in fit.validations:
        verdict = "fails" if unseen.failures else "holds"
        inside = "not judged" if np.isnan(unseen.inside) else f"{100.0 * unseen.inside:.0f} % inside the band"
        yield f"on {unseen.name}", f"{verdict}: fit {unseen.fit_percent:.2f} %, {inside}"


def trust_table(model: PlantModel) -> ResultTable:
    """Return what a model is trusted by: each number with its limit, and what it decides where it is beyond it."""
    rows = [
        (
            f"{row.name}, {row.where}" if row.where else row.name,
            row.measured,
            row.allowed,
            row.decides if row.beyond else "",
        )
        for row in model.trust
    ]
    return ResultTable("trust", ("what", "value", "limit", "decides"), tuple(rows))


def response_rows(fit: ResponseFit) -> list[tuple[str, str]]:
    """Return what `identify` prints of a model of a frequency response: name and value."""
    rows = []
    for name, values in (("numerator", fit.model.num), ("denominator", fit.model.den)):
        top = values.size - 1
        rows += [(f"{name}, s^{top - k}", f"{value:.5g}") for k, value in enumerate(values)]
    rows += [
        (f"fixed: {known.fixed.name}", f"{str(known.fixed).partition('=')[2]} {known.beside}") for known in fit.fixed
    ]
    rows.append(("dead time (ms)", f"{1e3 * fit.model.delay_s:.3g}"))
    return [*rows, ("largest departure from the response (dB)", f"{fit.largest_db:.2f}")]


def printed_polynomial(coefficients: FloatArray) -> str:
    """Return a polynomial in s as it is printed: four digits, no factor of one, no zero term."""
    order = len(coefficients) - 1
    terms = []
    for index, value in enumerate(coefficients):
        power = order - index
        if value == 0.0:
            continue
        symbol = "" if power == 0 else "s" if power == 1 else f"s{_superscript(power)}"
        number = "" if symbol and abs(value) == 1.0 else f"{abs(value):.4g}"
        terms.append((" − " if value < 0.0 else " + ") + number + symbol)
    text = "".join(terms)
    return text.removeprefix(" + ").replace(" − ", "−", 1) if text.startswith(" − ") else text.removeprefix(" + ")


def printed_polynomials(system: ContinuousSystem) -> tuple[str, str]:
    """Return the numerator and denominator of a continuous system as printed."""
    num, den = system.polynomials()
    return printed_polynomial(num), printed_polynomial(den)


def printed_factors(system: ContinuousSystem) -> str:
    """Return the system as a gain and a fraction of factors, each with one real root (rad/s) or one pair of roots.

    Factors keep the digits that a polynomial of high order loses. Roots at the origin come first, then by magnitude.
    """
    above, below = _factors(system.zeros), _factors(system.poles)
    gain = f"{system.gain:.6g}"
    top = f"{gain} {above}" if above else gain
    return f"{top} / ({below})" if below else top


def _factors(roots: np.ndarray[tuple[int], np.dtype[np.complex128]]) -> str:
    """Return the product of the factors of these roots; a pair is given by its root above the real axis."""
    real = roots.imag == 0.0
    upper = roots[roots.imag > 0.0]
    factors = [(abs(root), np.array([1.0, -root.real])) for root in roots[real]]
    factors += [(abs(root), np.array([1.0, -2.0 * root.real, abs(root) ** 2])) for root in upper]
    counted = Counter(_bracketed(values) for _, values in sorted(factors, key=lambda factor: factor[0]))
    return " ".join(text if times == 1 else text + _superscript(times) for text, times in counted.items())


def _bracketed(values: FloatArray) -> str:
    text = printed_polynomial(values)
    return text if text == "s" else f"({text})"


def _superscript(number: int) -> str:
    return str(number).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
