"""The table of an identification as texts: what was found, its value and its 95 % interval, as it is printed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from tactuator.identification.by_response import ResponseFit
from tactuator.identification.result import Identification, resonances


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


_SAID_BY = {"data": "by the data", "file": "by the record's own file", "asked": "as asked for"}


def identification_rows(found: Identification, about: Mapping[str, str]) -> Iterator[tuple[str, str, str]]:
    """Yield the rows of the table: what it is, its value, its 95 % interval (or nothing)."""
    model, confidence = found.model, found.model.confidence()
    for name, values, first in (("numerator", model.num, 0), ("denominator", model.den, 1)):
        top = values.size - 1
        for k in range(first, values.size):
            error = confidence[f"{name[:3]}_s{top - k}"]
            value, width = with_error(float(values[k]), error)
            yield f"{name}, s^{top - k}", value, "fixed" if found.fixed and error == 0.0 else width
    for known in found.fixed:
        yield f"fixed: {known.fixed.name}", str(known.fixed).partition("=")[2], known.beside
    yield "dead time (ms)", *with_error(1e3 * model.delay_s, 1e3 * confidence["delay_s"])
    yield "poles (Hz)", ", ".join(f"{pole:.4g}" for pole in found.poles_hz), ""
    for one in resonances(model.den):
        name = f"resonance at {one.frequency_hz:.4g} Hz"
        yield name, f"damping ratio {one.damping_ratio:.3g}, Q {one.q:.3g}", ""
    for words, value in _circumstances(found, about):
        yield words, value, ""
    if found.friction is not None:
        command, position = f"{model.command_unit} of command".strip(), f"{model.position_unit} of position".strip()
        level = with_error(found.friction.coulomb, found.friction.confidence)
        yield f"Coulomb friction ({command})", *level
        distance = found.friction.presliding
        yield f"presliding distance ({position})", "cannot tell" if distance is None else f"{distance:.3g}", ""


def _circumstances(found: Identification, about: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield what is to be known of the record, and how well the model follows it."""
    model = found.model
    sure = "" if found.between.certain else " (cannot be told; the band holds both)"
    yield "command between samples", f"{found.between.hold}, {_SAID_BY[found.between.source]}{sure}"
    yield "recorded in", {True: "closed loop", False: "open loop", None: "cannot tell"}[found.tests.feedback]
    if {"input", "output"} <= set(about):
        yield "columns", f"{about['input']} -> {about['output']}"
    yield "order of excitation by the command", str(found.excitation.order)
    if model.valid_hz is not None:
        yield "the model is valid over (Hz)", f"{model.valid_hz[0]:.4g} to {model.valid_hz[1]:.4g}"
    yield "widest 95 % band there (dB)", f"{float(np.max(model.band_db(found.frequency_hz()))):.2g}"
    yield "fit of the simulated position (%)", f"{found.fit_percent:.2f}"
    yield "residual is white noise", "yes" if found.tests.white else "no"
    yield "residual is free of the command", "yes" if found.tests.uncorrelated_with_input else "no"
    for unseen in found.validations:
        verdict = "fails" if unseen.failures else "holds"
        inside = "not judged" if np.isnan(unseen.inside) else f"{100.0 * unseen.inside:.0f} % inside the band"
        yield f"on {unseen.name}", f"{verdict}: fit {unseen.fit_percent:.2f} %, {inside}"


def response_rows(found: ResponseFit) -> list[tuple[str, str]]:
    """Return what `identify` prints of a model of a frequency response: name and value."""
    rows = []
    for name, values in (("numerator", found.model.num), ("denominator", found.model.den)):
        top = values.size - 1
        rows += [(f"{name}, s^{top - k}", f"{value:.5g}") for k, value in enumerate(values)]
    rows += [(f"fixed: {one.fixed.name}", f"{str(one.fixed).partition('=')[2]} {one.beside}") for one in found.fixed]
    rows.append(("dead time (ms)", f"{1e3 * found.model.delay_s:.3g}"))
    return [*rows, ("largest departure from the response (dB)", f"{found.largest_db:.2f}")]
