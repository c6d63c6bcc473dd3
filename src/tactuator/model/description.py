"""A display: channels with their plants, sensors, converters, loads, and what is asked of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactuator.errors import BadInput
from tactuator.model.load import DERIVATIVES, Load, Quantity
from tactuator.model.requirements import FeedbackRequirements, Objectives, PrefilterRequirements
from tactuator.model.sound_card import SoundCard
from tactuator.model.touch import Touch
from tactuator.perception.curve import ThresholdCurve
from tactuator.signals.systems import ContinuousSystem

HIGHEST_RATE_HZ = 1e6
"""Beyond it double precision has too few digits for what is slow."""
KNOWN_EDGE = 1.05
"""A frequency within this factor of `valid_hz` counts as known."""


@dataclass(frozen=True)
class Converter:
    """A/D and D/A alike: `bits` over +/- range_v. polarity (+1 or -1) and offset_v are the command's at the motor."""

    bits: int = 16
    range_v: float = 10.0
    polarity: int = 1
    offset_v: float = 0.0

    def __post_init__(self) -> None:
        if not 8 <= self.bits <= 24:
            raise BadInput(f"converter: bits is {self.bits}", "8 to 24")
        if not (np.isfinite(self.range_v) and self.range_v > 0.0):
            raise BadInput(f"converter: range_v is {self.range_v:g}", "a positive number of volts")
        if self.polarity not in (-1, 1):
            raise BadInput(f"converter: polarity is {self.polarity}", "1 or -1")
        if not abs(self.offset_v) < self.range_v:
            raise BadInput(f"converter: offset_v is {self.offset_v:g}", f"within +/- {self.range_v:g} V")

    @property
    def step_v(self) -> float:
        """Return one converter step, volts: the range over 2^bits codes."""
        return 2.0 * self.range_v / 2.0**self.bits


@dataclass(frozen=True)
class Threshold:
    """The curve a channel is to follow, over band_hz."""

    curve: ThresholdCurve
    band_hz: tuple[float, float] = (0.4, 300.0)

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not 0.0 < low < high:
            raise BadInput(f"threshold: band_hz is [{low:g}, {high:g}]", "0 < low < high")
        if not self.curve.covers(low, high):
            first, last = self.curve.frequency_hz[[0, -1]]
            raise BadInput(
                f"threshold curve {self.curve.name!r} reaches from {first:g} to {last:g} Hz",
                f"one that covers the band of {low:g} to {high:g} Hz",
            )


DISTURBANCES = ("hum", "noise", "friction")


@dataclass(frozen=True)
class Environment:
    """Disturbances of a channel: hum (volts peak at the sensor) at hum_hz, white sensor noise, Dahl friction.

    friction_v: Coulomb level in volts of command. presliding_v: sensor volts over which it builds up. The figures are
    what the display is believed to have: the simulated display obeys them, the verdict is judged by them. assumed:
    which of `DISTURBANCES` nobody has stated or measured; a verdict tells what rests on them and does not judge it.
    """

    hum_hz: tuple[float, ...] = (60.0, 120.0, 180.0)
    hum_v_peak: tuple[float, ...] = (1.0e-3, 0.3e-3, 0.2e-3)
    noise_v_rms: float = 0.2e-3
    friction_v: float = 4.0e-3
    presliding_v: float = 10.0e-3
    assumed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        unknown = sorted(set(self.assumed) - set(DISTURBANCES))
        if unknown:
            raise BadInput(f"environment: assumed has {unknown[0]!r}", f"{', '.join(DISTURBANCES)}")
        if len(self.hum_hz) != len(self.hum_v_peak):
            raise BadInput(
                f"environment: {len(self.hum_hz)} hum_hz and {len(self.hum_v_peak)} hum_v_peak", "as many of each"
            )
        figures = (*self.hum_hz, *self.hum_v_peak, self.noise_v_rms, self.friction_v)
        if min(figures) < 0.0 or self.presliding_v <= 0.0:
            raise BadInput("environment: a figure is negative or presliding_v zero", "zero or more, and above")


@dataclass(frozen=True)
class Channel:
    """The actuator of one finger.

    plant: command (V) to sensor voltage (V); quantity: what that voltage is proportional to, with
    sensor_gain_v_per_mm in volts per mm, mm/s or mm/s^2 accordingly. travel_mm: mechanical limit, +/-. family: other
    plants that identification cannot tell from `plant`; a design must hold for them too. covariance: of the plant's
    numerator, its monic denominator after the leading one, and its dead time, as `identify` found it; empty: unknown.
    valid_hz: where the plant is known (None: everywhere). model_error_db: what its magnitude may be off there, most of
    all between the two frequencies model_error_hz (None: not known where).
    """

    name: str
    finger: str
    sensor_gain_v_per_mm: float
    travel_mm: float
    plant: ContinuousSystem
    threshold: Threshold
    quantity: Quantity = "displacement"
    loads: tuple[Load, ...] = ()
    converter: Converter = field(default_factory=Converter)
    feedback: FeedbackRequirements = field(default_factory=FeedbackRequirements)
    prefilter: PrefilterRequirements = field(default_factory=PrefilterRequirements)
    environment: Environment = field(default_factory=Environment)
    family: tuple[ContinuousSystem, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    valid_hz: tuple[float, float] | None = None
    model_error_db: float = 0.0
    model_error_hz: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for key in ("sensor_gain_v_per_mm", "travel_mm"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0.0):
                raise BadInput(f"channel {self.name!r}: {key} is {value:g}", "a positive number")
        if self.quantity not in DERIVATIVES:
            raise BadInput(f"channel {self.name!r}: quantity {self.quantity!r}", f"{', '.join(DERIVATIVES)}")
        size = self.plant.zeros.size + self.plant.poles.size + 2
        if self.covariance and {len(self.covariance), *(len(row) for row in self.covariance)} != {size}:
            raise BadInput(
                f"channel {self.name!r}: covariance of {len(self.covariance)} rows", f"{size} rows of {size}"
            )
        for key, pair in (("valid_hz", self.valid_hz), ("model_error_hz", self.model_error_hz)):
            if pair is not None and not 0.0 < pair[0] < pair[1]:
                raise BadInput(f"channel {self.name!r}: {key} is [{pair[0]:g}, {pair[1]:g}]", "0 < low < high")
        if len({load.name for load in self.loads}) != len(self.loads):
            raise BadInput(f"channel {self.name!r}: two loads have the same name", "each name once")

    def is_known(self, frequency_hz: ArrayLike) -> NDArray[np.bool_]:
        """Tell, frequency by frequency, whether the plant is known there; an edge counts with what rounding makes of
        it.
        """
        frequency = np.asarray(frequency_hz, dtype=np.float64)
        low, high = self.valid_hz or (0.0, np.inf)
        return np.asarray((frequency >= low / KNOWN_EDGE) & (frequency <= high * KNOWN_EDGE))

    def load(self, name: str) -> Load:
        """Return the load of that name. Raises BadInput if there is none."""
        for load in self.loads:
            if load.name == name:
                return load
        allowed = ", ".join(load.name for load in self.loads) or "none is described"
        raise BadInput(f"channel {self.name!r}: load {name!r} is not described", f"{allowed}")

    def loaded_plant(self, load: Load | None) -> ContinuousSystem:
        """Return the plant under `load`; for None, the plant without load."""
        return self.plant if load is None else load.applied_to(self.plant, self.quantity)

    def threshold_voltage(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Return the |H| that the curve asks for: peak volts of y at threshold (r = 1), at `frequency_hz`
        (any shape).
        """
        frequency = np.asarray(frequency_hz, dtype=np.float64)
        speed = (2.0 * np.pi * frequency) ** DERIVATIVES[self.quantity]
        return self.sensor_gain_v_per_mm * self.threshold.curve.displacement_mm(frequency) * speed


@dataclass(frozen=True)
class Display:
    """Channels that share one rate and one computing delay (samples from A/D to D/A). sound: their wiring to a sound
    card, None where nothing is said of it.
    """

    name: str
    rate_hz: float
    delay_samples: int
    channels: tuple[Channel, ...]
    objectives: Objectives = field(default_factory=Objectives)
    sound: SoundCard | None = None
    touch: Touch = field(default_factory=Touch)

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz <= HIGHEST_RATE_HZ:
            raise BadInput(f"display: rate_hz is {self.rate_hz:g}", f"up to {HIGHEST_RATE_HZ:g} Hz")
        if self.delay_samples not in range(9):
            raise BadInput(f"display: delay_samples is {self.delay_samples}", "0 to 8")
        if not self.channels:
            raise BadInput("display: no channel", "one or more")
        if len({channel.name for channel in self.channels}) != len(self.channels):
            raise BadInput("display: two channels have the same name", "each name once")
        if self.sound is not None and len(self.sound.wires) != len(self.channels):
            raise BadInput(f"display: {len(self.sound.wires)} wires for {len(self.channels)} channels", "one for each")
        self._check_bands()

    def _check_bands(self) -> None:
        for channel in self.channels:
            high = channel.threshold.band_hz[1]
            if self.rate_hz < 4.0 * high:
                raise BadInput(
                    f"display: rate_hz is {self.rate_hz:g} for a band up to {high:g} Hz", f"{4.0 * high:g} or more"
                )

    def channel(self, name: str) -> Channel:
        """Return the channel of that name. Raises BadInput if there is none."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        allowed = ", ".join(channel.name for channel in self.channels)
        raise BadInput(f"display: channel {name!r} is not described", f"{allowed}")
