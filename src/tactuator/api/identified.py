"""Models that were identified, of a record or of a response, and a sensor's gain, with a result's manners."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactuator.api.parameters import Place
from tactuator.identification.by_response import ResponseFit
from tactuator.identification.distortion import Distortion
from tactuator.identification.fixed_values import FixedAgainstOwn
from tactuator.identification.result import Identification, Validation, resonances
from tactuator.identification.trust import FASTEST, GROWING
from tactuator.io.atomic import write_text
from tactuator.io.model import identified_text
from tactuator.model.plant_model import PlantModel
from tactuator.report.tables import identification_rows, response_rows, trust_table
from tactuator.result import Fact, Result, coefficients, data, found
from tactuator.signals.decibels import db
from tactuator.table import Chart, ChartLine, ResultTable, picked, plain

DELAY_SAYS = (
    "delay_s is everything between the command and the position as recorded, the laboratory's converters and filters "
    "included; the display's delay_samples is its own computing delay and comes on top"
)


_HELPS = (
    "what may help: --order with the number of poles that you expect (2 for a motor on a spring), a longer record, or "
    "one without a loop around the plant"
)


class _FittedResult(Result):
    """What models of a record and of a response share: what is to be known of them, their verdict and their file."""

    model: PlantModel
    order: int
    remarks: tuple[str, ...]
    fixed: tuple[FixedAgainstOwn, ...]

    def frequency_hz(self, count: int = 500) -> Any:
        """Return frequencies even in log over the model's band, (count,)."""
        return np.geomspace(*self.model.band_hz, count)

    def _fitted(self, *fit: Fact) -> list[Fact]:
        trusted = "no: " + "; ".join(self.model.distrust) if self.model.distrust else "yes"
        num, den = coefficients(self.model.num), coefficients(self.model.den)
        told = [found("num", num), found("den", den), *fit, found("trusted", trusted)]
        return [*told, *data(self._document())]

    def notices(self) -> Sequence[str]:
        return [
            *(f"note: {remark}" for remark in self.remarks),
            *(f"the record cannot tell: {row}" for row in self.model.trust if row.leaves_open),
            *(f"the model is not to be trusted: {reason}" for reason in self.model.distrust),
        ]

    @property
    def holds(self) -> bool:
        return not self.model.distrust

    def next_step(self) -> str:
        return "plant = this file in a display, or `tactuator init --from` it" if self.holds else ""

    def columns(self) -> Mapping[str, Any]:
        frequency = self.frequency_hz()
        response = self.model.response(frequency)
        return {
            "frequency_hz": frequency,
            "magnitude_db": 20.0 * np.log10(np.abs(response)),
            "phase_deg": np.degrees(np.unwrap(np.angle(response))),
            "band_db": self.model.band_db(frequency),
            "band_deg": np.degrees(self.model.band_rad(frequency)),
        }

    def chart(self) -> Chart:
        return self.model.chart()

    def write(self, path: Place) -> None:
        write_text(path, identified_text(self.model))

    def _document(self) -> dict[str, Any]:
        model = self.model
        confidence = model.confidence()
        n, m = model.den.size - 1, model.num.size - 1
        return {
            "model": picked(model, *_POLYNOMIALS),
            "damping": [vars(resonance) for resonance in resonances(model.den)],
            "confidence": {
                "gain": confidence["gain"],
                "num": [confidence[f"num_s{m - k}"] for k in range(m + 1)],
                "den": [0.0, *(confidence[f"den_s{n - 1 - k}"] for k in range(n))],
                "delay_s": confidence["delay_s"],
            },
            "zeros": m,
            "method": model.method,
            "valid_hz": model.valid_hz,
            "delay": DELAY_SAYS,
            "units": {"command": model.command_unit, "position": model.position_unit},
            "poles_hz": np.sort(np.abs(np.roots(model.den))) / (2.0 * np.pi),
            "order": self.order,
            "trusted": not self.model.distrust,
            "distrust": self.model.distrust,
            "trust": [{**plain(row), "beyond": row.beyond} for row in model.trust],
            "frf": self.columns(),
            "remarks": self.remarks,
            "fixed": [_fixed_document(value) for value in self.fixed],
        }


@dataclass(frozen=True, eq=False, repr=False)
class IdentificationResult(_FittedResult, Identification):
    """A model with the evidence for it. It draws the model's response over what the record shows of it.

    about: what the record tells of itself; out: the file to which the model was written.
    """

    about: Mapping[str, str] | None = None
    out: Path | None = None

    def notices(self) -> Sequence[str]:
        unlikely = any(row.refuses and row.name in (GROWING.name, FASTEST.name) for row in self.model.trust)
        return [*super().notices(), *([_HELPS] if unlikely or (self.tests.feedback and not self.holds) else [])]

    def chart(self) -> Chart:
        hertz, value, error = self.shown()
        half = 20.0 / np.log(10.0) * 1.959964 * error
        return self.model.chart(ChartLine("record, ± 95 %", hertz, db(value), "o", half, colour=1))

    def tables(self) -> Sequence[ResultTable | str]:
        title = f"{self.model.method}: {self.order} poles, {self.model.num.size - 1} zeros"
        rows = tuple(identification_rows(self, self.about or {}))
        return [ResultTable(title, ("what", "value", "±95 %"), rows), trust_table(self.model)]

    def facts(self) -> Sequence[Fact]:
        about, excitation = self.about or {}, self.excitation
        other = None if self.other is None else picked(self.other, *_POLYNOMIALS)
        band_hz = [excitation.low_hz, excitation.high_hz]
        documents = {
            "hold": picked(self.between, "source", "certain", "advantage", taken="hold") | {"other": other},
            "excitation": picked(excitation, "order", "needed", "sufficient") | {"band_hz": band_hz},
            "residuals": picked(self.tests, *_TESTS, "white", "uncorrelated_with_input", closed_loop="feedback"),
            "validation": [_validation_document(validation) for validation in self.validations],
            "friction": self._friction_document(),
            "mechanism": self._mechanism_document(),
            "distortion": None if self.distortion is None else _distortion_document(self.distortion),
            "tried": [vars(candidate) for candidate in self.tried],
            "columns": {name: about.get(name) for name in ("input", "output")},
        }
        fit = Fact("fit_percent", self.fit_percent, "fit", "%", ".5g", True)
        return [*self._fitted(fit), *data(documents), Fact("out", self.out)]

    def _mechanism_document(self) -> dict[str, float] | None:
        if self.mass_and_viscous is None:
            return None
        names = ("mass", "mass_confidence", "viscous", "viscous_confidence")
        return dict(zip(names, np.ravel(self.mass_and_viscous).tolist(), strict=True))

    def _friction_document(self) -> dict[str, Any]:
        if self.friction is None:
            return {"coulomb": 0.0, "confidence": None, "presliding": None, "command_for_1_db": None}
        return picked(self.friction, "coulomb", "confidence", "presliding", command_for_1_db="small_command")


@dataclass(frozen=True, eq=False, repr=False)
class ResponseModelResult(_FittedResult, ResponseFit):
    """A model of a frequency response. It draws the model's response. out: the file to which it was written."""

    out: Path | None = None

    def tables(self) -> Sequence[ResultTable | str]:
        title = f"response: {self.order} poles, {self.model.num.size - 1} zeros"
        return [ResultTable(title, ("what", "value"), tuple(response_rows(self))), trust_table(self.model)]

    def facts(self) -> Sequence[Fact]:
        largest = Fact("largest_db", self.largest_db, "departure", "dB", ".3g", True)
        return [*self._fitted(largest), Fact("departure", self.departure), Fact("out", self.out)]


_POLYNOMIALS = ("num", "den", "delay_s")
_TESTS = ("white_p", "uncorrelated_p", "unexplained")


def _fixed_document(known: FixedAgainstOwn) -> dict[str, Any]:
    """Return a value that was fixed, beside what the record shows without it (null: it shows no such thing)."""
    value, confidence = known.by_record or (None, None)
    return {"name": known.fixed.name, "value": known.fixed.value, "own": value, "own_confidence": confidence}


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
