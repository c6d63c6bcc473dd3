"""The result of an identification: the model, its tests, and what a user must know about both."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.check import EmpiricalResponse, ExcitationReport
from tactuator.identification.distortion import Distortion
from tactuator.identification.fitted import POLYNOMIALS, Fitted, Resonance, resonances, trust_table
from tactuator.identification.fixed_values import FixedAgainstOwn
from tactuator.identification.hold import HOLDS, Hold
from tactuator.identification.residual_tests import ResidualTests
from tactuator.identification.trust import FASTEST, GROWING, VALID
from tactuator.identification.uncertainty import fit_of_model, response_of_rows
from tactuator.model.plant_model import DB, Z95, PlantModel, QualityCheck, reasons
from tactuator.plain import picked, with_error
from tactuator.result import Chart, ChartLine, Fact, ResultTable, data
from tactuator.signals.decibels import db


@dataclass(frozen=True)
class Friction:
    """Levels in units of command, with their 95 % half-widths.

    coulomb: what friction takes. presliding: units of position over which it builds up after a reversal (Dahl); None
    where the record cannot tell. small_command: amplitude of a slow command of which friction takes 1 dB.
    """

    coulomb: float
    confidence: float
    presliding: float | None

    @property
    def stated(self) -> dict[str, float]:
        """Return what a model file says of it; an unknown presliding distance is left out."""
        known = {} if self.presliding is None else {"presliding": self.presliding}
        return {"coulomb": self.coulomb, **known}

    @property
    def small_command(self) -> float:
        """Return the level by the describing function of Coulomb friction, 4 c/(pi U), in phase at worst."""
        return float(4.0 * self.coulomb / np.pi / (1.0 - 10.0 ** (-1.0 / 20.0)))


@dataclass(frozen=True)
class Candidate:
    """One form that was tried: half of -2 log likelihood, its hold, and how far its criterion (Bayes) is behind."""

    poles: int
    zeros: int
    dead_time: bool
    cost: float
    hold: str
    behind: float


@dataclass(frozen=True)
class BetweenSamples:
    """The command between its samples. hold: what the command is taken to do between its samples. source: "asked",
    "file" or "data". certain: the data (or the file) decide between the two; advantage: by how much of -2 log
    likelihood.
    """

    hold: str = "zero-order"
    source: str = "asked"
    certain: bool = True
    advantage: float = float("inf")


@dataclass(frozen=True)
class Validation:
    """A model's standing on one record that its fit never saw.

    fit_percent: 100 (1 - |y - simulated| / |y - mean|). tests: of what is left. inside: share of the record's own
    response (points: how many there are, magnitude and phase counted each) within the model's 95 % band and its own
    error, nan where nothing can be compared. checks: what decides whether the model holds there. remarks: what was
    done to the record.
    """

    name: str
    fit_percent: float
    tests: ResidualTests
    inside: float
    points: int
    checks: tuple[QualityCheck, ...]
    remarks: tuple[str, ...]

    @property
    def failures(self) -> tuple[str, ...]:
        """Return why the model fails there, empty if it does not."""
        return reasons(self.checks)


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Fitted):
    """A model and how it was found. model: with covariance. order: poles. tried: structures in the order of trial.
    friction: None if none is certain.

    empirical: the record's own response in bands, for figures. simulated, measured: position by the model and as
    recorded, (k,), the last k samples of the part used. remarks: what a user must know. other: the model under the
    other hold if the record cannot separate them. validations: tests of the model on other records.
    distortion: what a periodic record shows beside its response, None for any other. fixed: the values that were fixed,
    beside the record's own.
    """

    model: PlantModel
    order: int
    excitation: ExcitationReport
    tests: ResidualTests
    fit_percent: float
    friction: Friction | None
    tried: tuple[Candidate, ...]
    empirical: EmpiricalResponse
    simulated: FloatArray
    measured: FloatArray
    remarks: tuple[str, ...]
    between: BetweenSamples = BetweenSamples()
    other: PlantModel | None = None
    validations: tuple[Validation, ...] = ()
    distortion: Distortion | None = None
    fixed: tuple[FixedAgainstOwn, ...] = ()
    path: FloatArray | None = None
    about: Mapping[str, str] | None = None
    out: Path | None = None

    def shown(self) -> tuple[FloatArray, ComplexArray, FloatArray]:
        """Return what the record shows of the plant: frequencies, response, its relative standard error; all (m,).

        It is the response from the command's samples to the position's, without what the hold between the samples does
        to the model: what is left is that of the continuous plant, as the model's is.
        """
        seen = self.empirical.trusted()
        hertz, value, error = seen.frequency_hz, seen.value, seen.relative_error
        if self.distortion is not None:
            hertz, value = self.distortion.frequency_hz, self.distortion.value
            error = np.sqrt(self.distortion.variance / 2.0) / np.abs(value)
        low, high = self.model.band_hz
        rate_hz = float(self.model.record.get("rate_hz", 0.0) or 0.0)
        inside = (hertz >= low) & (hertz <= high)
        hertz, value, error = hertz[inside], value[inside], error[inside]
        hold: Hold = next((hold for hold in HOLDS if hold == self.between.hold), "zero-order")
        if hold == "band-limited" or rate_hz <= 0.0:
            return hertz, value, error
        held = response_of_rows(fit_of_model(self.model, rate_hz, hold, 1.0), hertz)
        return hertz, value * self.model.response(hertz) / held, error

    @property
    def mass_and_viscous(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Return mass (command over acceleration) and viscous damping (command over velocity) of a mechanism of two
        poles and no zero, each with its 95 % half-width; None of any other.
        """
        if self.model.num.size != 1 or self.model.den.size != 3:
            return None
        gain, damping = float(self.model.num[0]), float(self.model.den[1])
        slopes = np.array([[-1.0 / gain**2, 0.0], [-damping / gain**2, 1.0 / gain]])
        half = Z95 * np.sqrt((slopes @ self.model.covariance[:2, :2] @ slopes.T).diagonal())
        return (1.0 / gain, float(half[0])), (damping / gain, float(half[1]))

    @property
    def poles_hz(self) -> FloatArray:
        """Return |pole| / 2 pi, ascending, (order,)."""
        return np.sort(np.abs(np.roots(self.model.den))) / (2.0 * np.pi)

    @property
    def resonances(self) -> tuple[Resonance, ...]:
        """Return the model's resonances, by frequency."""
        return resonances(self.model.den)

    def notices(self) -> Sequence[str]:
        """Return doubts about the model, and what may help."""
        unlikely = any(row.refuses and row.name in (GROWING.name, FASTEST.name, VALID.name) for row in self.model.trust)
        return [*super().notices(), *([_HELPS] if unlikely or (self.tests.feedback and not self.holds) else [])]

    def chart(self) -> Chart:
        """Return the magnitude with its 95 % band."""
        hertz, value, error = self.shown()
        half = DB * Z95 * error
        return self.model.chart(ChartLine("record, ± 95 %", hertz, db(value), "o", half, colour=1))

    def tables(self) -> Sequence[ResultTable]:
        """Return the model with its confidence, and what it is trusted by."""
        title = f"{self.model.method}: {self.order} poles, {self.model.num.size - 1} zeros"
        rows = tuple(_rows(self, self.about or {}))
        return [ResultTable(title, ("what", "value", "±95 %"), rows), trust_table(self.model)]

    def facts(self) -> Sequence[Fact]:
        """Return the fit, the model and what it rests on."""
        about, excitation = self.about or {}, self.excitation
        other = None if self.other is None else picked(self.other, *POLYNOMIALS)
        band_hz = [excitation.low_hz, excitation.high_hz]
        documents = {
            "hold": picked(self.between, "source", "certain", "advantage", taken="hold") | {"other": other},
            "excitation": picked(excitation, "order", "needed", "sufficient") | {"band_hz": band_hz},
            "residuals": picked(
                self.tests, *_TESTS, "white", "uncorrelated_with_input", closed_loop="feedback", feedback="feedback_is"
            ),
            "validation": [_validation_document(validation) for validation in self.validations],
            "friction": self._friction_document(),
            "mechanism": self._mechanism_document(),
            "distortion": None if self.distortion is None else _distortion_document(self.distortion),
            "tried": [vars(candidate) for candidate in self.tried],
            "columns": {name: about.get(name) for name in ("input", "output")},
        }
        fit = Fact("fit_percent", self.fit_percent, "fit", "%", ".5g", True)
        return [*self.fitted(fit), *data(documents), Fact("out", self.out)]

    def _mechanism_document(self) -> dict[str, float] | None:
        if self.mass_and_viscous is None:
            return None
        names = ("mass", "mass_confidence", "viscous", "viscous_confidence")
        return dict(zip(names, np.ravel(self.mass_and_viscous).tolist(), strict=True))

    def _friction_document(self) -> dict[str, Any]:
        if self.friction is None:
            return {"coulomb": 0.0, "confidence": None, "presliding": None, "command_for_1_db": None}
        return picked(self.friction, "coulomb", "confidence", "presliding", command_for_1_db="small_command")


_HELPS = (
    "what may help: `order` with the number of poles that you expect (2 for a motor on a spring), a longer record, or "
    "one without a loop around the plant"
)
_TESTS = ("white_p", "uncorrelated_p", "unexplained")


@np.errstate(divide="ignore")
def _distortion_document(seen: Distortion) -> dict[str, Any]:
    levels = {
        f"{name}_db": 20.0 * np.log10(getattr(seen, name)) for name in ("noise", "total", "distortion", "even", "odd")
    }
    response = {"frequency_hz": seen.frequency_hz, "response_db": 20.0 * np.log10(np.abs(seen.value))}
    return response | levels | {"realisations": seen.realisations}


def _validation_document(validation: Validation) -> dict[str, Any]:
    document = picked(validation, "failures", "fit_percent", "points", record="name", inside_band="inside")
    return document | {"holds": not validation.failures, "residuals": picked(validation.tests, *_TESTS)}


_BETWEEN = {
    "zero-order": "held constant (zero-order hold)",
    "first-order": "joined by straight lines (first-order hold)",
    "band-limited": "smooth, through a filter (band-limited)",
}
_SAID_BY = {"file": "known: the record's file says so", "asked": "known: as stated"}


def _rows(fit: Identification, about: Mapping[str, str]) -> Iterator[tuple[str, str, str]]:
    """Yield the rows of the table: what it is, its value, its 95 % interval (or nothing)."""
    model, confidence = fit.model, fit.model.confidence()
    for name, values, first in (("numerator", model.num, 0), ("denominator", model.den, 1)):
        top = values.size - 1
        for k in range(first, values.size):
            error = confidence[f"{name[:3]}_s{top - k}"]
            yield f"{name}, s^{top - k}", *with_error(float(values[k]), error)
    for known in fit.fixed:
        yield f"fixed: {known.fixed.name}", str(known.fixed).partition("=")[2], known.beside
    late_s = model.delay_s - model.record.get("skew_s", 0.0)
    yield "dead time (ms)", *with_error(1e3 * late_s, 1e3 * confidence["delay_s"])
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
    said = "unknown, taken as this; the band covers the other as well"
    if fit.between.certain:
        said = f"likely: -2 log likelihood is better by {fit.between.advantage:.3g} than of the other"
    said = _SAID_BY.get(fit.between.source, said)
    yield "command between samples", f"{_BETWEEN[fit.between.hold]}, {said}"
    yield "feedback during the recording", fit.tests.feedback_is
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
