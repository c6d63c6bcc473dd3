"""What models of a record and of a response are: a result with the evidence for it, and a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.fixed_values import FixedAgainstOwn
from tactuator.io.atomic import write_text
from tactuator.io.model import identified_text
from tactuator.model.plant_model import PlantModel
from tactuator.parameters import checked
from tactuator.plain import picked, plain
from tactuator.result import Chart, Fact, Result, ResultTable, data, found

DELAY_SAYS = (
    "delay_s is everything between the command and the position as recorded, the laboratory's converters and filters "
    "included; the display's delay_samples is its own computing delay and comes on top"
)
POLYNOMIALS = ("num", "den", "delay_s")


@dataclass(frozen=True)
class Resonance:
    """A pair of complex poles: |pole| / 2 pi, damping ratio, Q = 1 / (2 damping ratio)."""

    frequency_hz: float
    damping_ratio: float
    q: float


def resonances(den: FloatArray) -> tuple[Resonance, ...]:
    """Return the complex pairs among the roots of `den` (descending powers of s), by frequency."""
    poles = np.roots(den)
    upper = poles[poles.imag > 1e-9 * np.abs(poles)]
    pairs = []
    for pole in sorted(upper, key=abs):
        ratio = float(-pole.real / abs(pole))
        pairs.append(Resonance(float(abs(pole) / (2.0 * np.pi)), ratio, 0.5 / ratio if ratio else float("inf")))
    return tuple(pairs)


class Fitted(Result):
    """What models of a record and of a response share: their facts, their verdict and their file."""

    model: PlantModel
    order: int
    remarks: tuple[str, ...]
    fixed: tuple[FixedAgainstOwn, ...]

    def frequency_hz(self, count: int = 500) -> Any:
        """Return frequencies even in log over the model's band, (count,)."""
        return np.geomspace(*self.model.band_hz, count)

    def fitted(self, *fit: Fact) -> list[Fact]:
        """Return the facts that both share, with how well the model fits."""
        trusted = "no: " + "; ".join(self.distrust) if self.distrust else "yes"
        return [*self.model.described(), *fit, found("trusted", trusted), *data(self._document())]

    def notices(self) -> Sequence[str]:
        """Return remarks, what the record cannot decide, and reasons not to trust the model."""
        return [
            *(f"note: {remark}" for remark in self.remarks),
            *(f"the record cannot tell: {row}" for row in self.model.trust if row.leaves_open),
            *(f"the model is not to be trusted: {reason}" for reason in self.distrust),
        ]

    @property
    def distrust(self) -> tuple[str, ...]:
        """Return why the model is not to be trusted, empty if it is."""
        return self.model.distrust

    @property
    def holds(self) -> bool:
        """Return whether the model is to be trusted."""
        return not self.distrust

    def next_step(self) -> str:
        """Return where the model goes."""
        return "plant = this file in a display, or `tactuator init --from` it" if self.holds else ""

    def columns(self) -> Mapping[str, Any]:
        """Return the response with its confidence band."""
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
        """Return the magnitude with its 95 % band."""
        return self.model.chart()

    @checked
    def write(self, path: str | PathLike[str]) -> None:
        """Write the model file, whole or not at all."""
        write_text(path, identified_text(self.model), "model")

    def _document(self) -> dict[str, Any]:
        model = self.model
        confidence = model.confidence()
        n, m = model.den.size - 1, model.num.size - 1
        return {
            "model": picked(model, *POLYNOMIALS),
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
            "trusted": not self.distrust,
            "distrust": self.distrust,
            "trust": [{**plain(row), "beyond": row.beyond} for row in model.trust],
            "frf": self.columns(),
            "remarks": self.remarks,
            "fixed": [_fixed_document(value) for value in self.fixed],
        }


def _fixed_document(known: FixedAgainstOwn) -> dict[str, Any]:
    """Return a value that was fixed, beside what the record shows without it (null: it shows no such thing)."""
    value, confidence = known.by_record or (None, None)
    return {"name": known.fixed.name, "value": known.fixed.value, "own": value, "own_confidence": confidence}


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
