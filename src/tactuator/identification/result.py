"""The result of an identification: the model, its tests, and what a user must be told of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactuator.arrays import ComplexArray, FloatArray
from tactuator.identification.check import EmpiricalResponse, ExcitationReport
from tactuator.identification.distortion import Distortion
from tactuator.identification.fixed_values import FixedAgainstOwn
from tactuator.identification.hold import HOLDS, Hold
from tactuator.identification.residual_tests import ResidualTests
from tactuator.identification.uncertainty import fit_of_model, response_of_rows
from tactuator.model.plant_model import PlantModel, QualityCheck, reasons


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
        """Return what a model file says of it; a presliding distance that nobody can tell is left out."""
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
    "file" or "data". certain: the data (or the file) tell it from the other; advantage: by how much of -2 log
    likelihood.
    """

    hold: str = "zero-order"
    source: str = "asked"
    certain: bool = True
    advantage: float = float("inf")


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


@dataclass(frozen=True, eq=False)
class Identification:
    """A model and how it was found. model: with covariance. order: poles. tried: structures in the order of trial.
    friction: None if none is certain.

    empirical: the record's own response in bands, for figures. simulated, measured: position by the model and as
    recorded, (k,), the last k samples of the part used. remarks: what a user must be told. other: the model under the
    other hold where the record cannot tell them apart. validations: how the model stands on records that it never saw.
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
        half = 1.959964 * np.sqrt((slopes @ self.model.covariance[:2, :2] @ slopes.T).diagonal())
        return (1.0 / gain, float(half[0])), (damping / gain, float(half[1]))

    @property
    def distrust(self) -> tuple[str, ...]:
        """Return why the model is not to be trusted, empty if it is."""
        return self.model.distrust

    @property
    def poles_hz(self) -> FloatArray:
        """Return |pole| / 2 pi, ascending, (order,)."""
        return np.sort(np.abs(np.roots(self.model.den))) / (2.0 * np.pi)

    @property
    def resonances(self) -> tuple[Resonance, ...]:
        """Return the model's resonances, by frequency."""
        return resonances(self.model.den)

    def frequency_hz(self, count: int = 500) -> FloatArray:
        """Return the frequencies even in log over 0.4 .. 300 Hz, or what the record supports of it, (count,)."""
        return np.geomspace(*self.model.band_hz, count)
