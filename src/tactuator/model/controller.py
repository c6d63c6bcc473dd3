"""A designed controller: the sections of F and C for every channel, what it feeds forward, where they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from tactuator import __version__
from tactuator.arrays import ComplexArray, FloatArray
from tactuator.errors import BadInput, unknown
from tactuator.model.description import Channel, Display, display_document, document_hash
from tactuator.parameters import NotNegative, Number, Numbers, Positive, Whole, kept_by, table
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.plain import brief, plain
from tactuator.signals.systems import SampledSystem, check_sections

PREVIEW_MAX = 16
"""Samples from the command to the reading that the core's model can look ahead."""


@table("touch")
class FeedForward:
    """Model of a channel's motor and of the finger it was designed for, and how the finger's weights are learnt.

    gain, damping, stiffness: the plant gain/(s^2 + damping s + stiffness). load: mass, damping and stiffness of the
    finger, in the plant's units. delay_samples: from a command to the reading it acts on. turns: it learns in every
    turns-th sample. corner_hz: of three poles through which it looks; slow_hz: below it is not looked at. forgetting_s:
    the shortest memory. gate_v, ridge_v: rms of the pushes (volts of command) at which the memory is twice as long, and
    at which zero weighs as much as what is heard. shape: the lean towards the designed finger's proportions.
    fading_s: the weights' decay while there is nothing to learn from. slew_s: the least time for a change of one.
    weight_max: of either weight. push_max_v: the greatest command that is fed forward. hum_hz, hum_band_hz: mains lines
    that are kept out of the estimate, and the width of their notches. mass_fed: the share of what the learnt mass takes
    that is fed forward.
    """

    gain: Positive
    damping: Number
    stiffness: Number
    load: tuple[Number, Number, Number]
    delay_samples: Annotated[Whole, Field(ge=1, le=PREVIEW_MAX)]
    turns: Annotated[Whole, Field(ge=1)]
    corner_hz: Positive
    slow_hz: NotNegative
    forgetting_s: Positive
    gate_v: Positive
    ridge_v: Positive
    shape: NotNegative
    fading_s: Positive
    slew_s: Positive
    weight_max: NotNegative
    push_max_v: NotNegative
    hum_hz: tuple[Number, ...] = ()
    hum_band_hz: NotNegative = 0.4
    mass_fed: NotNegative = 1.0

    __repr__ = brief


@table("strength")
class StrengthShaping:
    """How the core reshapes a channel's reference by its own level, so that equal references are equally strong.

    pairs_hz: (p,), corners of the pairs of poles that all levels share, damping: of all of them. gains: (levels, 1 +
    2 p), for each level the gain of the reference itself, then of each pair's band-pass and low-pass; the levels are
    those of tones from 0 dB SL on, a doubling of power (10 log10 2 dB) each. follow_s: time constant of each of the
    level's two poles.
    """

    pairs_hz: Numbers
    damping: Positive
    gains: Numbers
    follow_s: Positive

    __repr__ = brief

    def response(self, strength_db_sl: float, frequency_hz: ArrayLike, rate_hz: float) -> ComplexArray:
        """Return what a tone of that level is multiplied by, at `frequency_hz` (any shape), once its level is known."""
        power = float(np.clip(10.0 ** (strength_db_sl / 10.0), 1.0, 2.0 ** (len(self.gains) - 1)))
        row = min(int(np.log2(power)), len(self.gains) - 2)
        part = power / 2.0**row - 1.0
        gains = self.gains[row] + part * (self.gains[row + 1] - self.gains[row])
        return np.asarray(shaping_basis(self.pairs_hz, self.damping, frequency_hz, rate_hz) @ gains)


def shaping_basis(pairs_hz: FloatArray, damping: float, frequency_hz: ArrayLike, rate_hz: float) -> ComplexArray:
    """Return what each gain of a shaping is a multiple of, at `frequency_hz`: 1, then band-pass and low-pass of each
    pair (core/strength/strength.h); shape of frequency_hz and (1 + 2 p,).
    """
    turn = pair_turns(pairs_hz, rate_hz)
    back = np.exp(-2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)[..., None] / rate_hz)
    change = 1.0 - back
    whole = change**2 + turn * back * (turn + damping * change)
    pairs = np.stack((turn * change / whole, turn**2 / whole), axis=-1).reshape(*whole.shape[:-1], -1)
    return np.concatenate((np.ones_like(back), pairs), axis=-1)


def pair_turns(pairs_hz: ArrayLike, rate_hz: float) -> FloatArray:
    """Return 2 sin(pi f T) of corners f: how far a pair turns in a sample."""
    return np.asarray(2.0 * np.sin(np.pi * np.asarray(pairs_hz, dtype=np.float64) / rate_hz))


FORMAT = "tactuator-controller/1"


@table("anti_windup")
class AntiWindup:
    """Back-calculation gains on the two states of the last feedback section (delta form): state_i += gain_i (clamped
    u - u), of what conditioning (tactuator.runtime.image) leaves of the difference."""

    gains: tuple[Number, Number] = (0.0, 0.0)


@table("limits")
class Limits:
    """Limits of one channel. command_v: the greatest |u|. travel_v: the sensor voltage at the mechanical limit.
    comfort_db_sl: the greatest felt level.
    """

    command_v: Number
    travel_v: Number
    comfort_db_sl: Number = COMFORT_DB_SL


def _sections(rows: Any) -> FloatArray:
    return check_sections(np.asarray(rows, dtype=np.float64))


Sections = Annotated[FloatArray, *kept_by(_sections, "rows b0, b1, b2, a0, a1, a2")]


@table("channel", eq=False)
class ChannelController:
    """F and C of one channel, as second-order sections (rows b0, b1, b2, a0, a1, a2) in double precision.

    prefilter_sos: (n, 6), maps r (threshold units) to volts of y, or to volts of u where feedback_sos is None.
    feedback_sos: (m, 6), the integrator in the last section. threshold_voltage_dc: H(0), volts of y per threshold
    unit. designed_for: names of the loads (and "family") the margins hold for. report: figures of the design, plain
    numbers and lists as in controller.json. feed_forward: for a finger, or None. strength: how the reference is
    reshaped by its level, None if it is not.
    """

    name: str
    threshold_voltage_dc: Number
    prefilter_sos: Sections
    feedback_sos: Sections | None
    anti_windup: AntiWindup
    limits: Limits
    designed_for: tuple[str, ...] = ()
    report: Mapping[str, Any] = field(default_factory=dict)
    feed_forward: FeedForward | None = None
    strength: StrengthShaping | None = None

    __repr__ = brief

    def prefilter(self, rate_hz: float) -> SampledSystem:
        """Return F as a sampled system."""
        return SampledSystem.from_sections(self.prefilter_sos, rate_hz)

    def feedback(self, rate_hz: float) -> SampledSystem | None:
        """Return C as a sampled system (without the computing delay), or None."""
        return None if self.feedback_sos is None else SampledSystem.from_sections(self.feedback_sos, rate_hz)

    def document(self) -> dict[str, Any]:
        """Return the channel as plain tables."""
        tables: dict[str, Any] = plain(self)
        absent = {key for key in ("feed_forward", "strength") if tables[key] is None}
        return {key: value for key, value in tables.items() if key not in absent}


@dataclass(frozen=True, eq=False)
class Controller:
    """Content of controller.json: one ChannelController for each channel of the display it was designed for."""

    display: Display
    channels: tuple[ChannelController, ...]
    tool: str = ""

    __repr__ = brief

    def __post_init__(self) -> None:
        mine = tuple(channel.name for channel in self.channels)
        theirs = tuple(channel.name for channel in self.display.channels)
        if mine != theirs:
            raise BadInput(f"controller is for channels {', '.join(mine)}; the display has {', '.join(theirs)}")

    @property
    def rate_hz(self) -> float:
        """Return the sampling rate, hertz."""
        return self.display.rate_hz

    @property
    def delay_samples(self) -> int:
        """Return the computing delay from A/D to D/A, samples."""
        return self.display.delay_samples

    def document(self) -> dict[str, Any]:
        """Return the tables of controller.json, the hash of their content included."""
        tables: dict[str, Any] = {
            "format": FORMAT,
            "tool": self.tool or __version__,
            "display": display_document(self.display),
            "rate_hz": self.rate_hz,
            "delay_samples": self.delay_samples,
            "channels": [channel.document() for channel in self.channels],
        }
        return {**tables, "hash": document_hash(tables)}

    @cached_property
    def content_hash(self) -> str:
        """Return SHA-256 (hex) of the document without its hash; a response, an image, an experiment record it."""
        return str(self.document()["hash"])

    def require_runs(self, display: Display) -> None:
        """Raise BadInput if `display` has other channels, another rate or another computing delay."""
        names = ", ".join(channel.name for channel in display.channels)
        mine = ", ".join(channel.name for channel in self.channels)
        if mine != names:
            raise BadInput(f"controller is for channels {mine}", f"{names}, as the display has")
        if (self.rate_hz, self.delay_samples) != (display.rate_hz, display.delay_samples):
            raise BadInput(
                f"controller is for {self.rate_hz:g} Hz and a delay of {self.delay_samples}",
                f"{display.rate_hz:g} Hz and {display.delay_samples}, as the display has",
            )

    def require_limits_of(self, display: Display) -> None:
        """Raise BadInput where a channel's figures are not those of a design for `display`: limits beyond what the
        display has, a threshold voltage or gains that are no positive numbers. A hash says who wrote a file, not
        that its figures make sense: what holds the command is derived from the display anew."""
        for designed, described in zip(self.channels, display.channels, strict=True):
            _require_limits(designed, described, display.objectives.comfort_db_sl)

    def channel(self, name: str) -> ChannelController:
        """Return the channel's controller. Raises BadInput for an unknown name."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise unknown("channel", name, [channel.name for channel in self.channels], where=("controller",))


def _require_limits(designed: ChannelController, described: Channel, comfort_db_sl: float) -> None:
    """Raise BadInput unless every figure is positive and no greater than the display's own limit."""
    where = ("controller", f"channel {designed.name!r}")
    travel_v = described.travel_mm * described.sensor_gain_v_per_mm
    greatest = {
        "command_v": (described.converter.range_v, "V, the converter's range"),
        "travel_v": (travel_v, "V at the sensor, the display's travel"),
        "comfort_db_sl": (comfort_db_sl, "dB SL, the display's comfort"),
    }
    for key, (most, words) in greatest.items():
        value = getattr(designed.limits, key)
        # rounding is no violation
        if not 0.0 < value <= most * (1.0 + 1e-9):
            raise BadInput(f"{value:g}", f"above 0, at most {most:g} {words}", where=(*where, "limits"), key=key)
    if not designed.threshold_voltage_dc > 0.0:
        value = designed.threshold_voltage_dc
        raise BadInput(f"{value:g}", "a positive number", where=where, key="threshold_voltage_dc")
    for key, sections in (("prefilter", designed.prefilter_sos), ("feedback", designed.feedback_sos)):
        if sections is None:
            continue
        with np.errstate(all="ignore"):
            size = np.abs(sections / sections[:, 3:4])
        if not np.all(np.isfinite(size) & ((size == 0.0) | (size >= _LEAST)) & (size <= _GREATEST)):
            allowed = f"0, or {_LEAST:g} to {_GREATEST:g} of a0"
            raise BadInput(f"a coefficient of its {key} is out of range", allowed, where=where)
    for gain in designed.anti_windup.gains:
        if not 0.0 <= gain <= _GAIN_MAX:
            raise BadInput(f"an anti-windup gain is {gain:g}", f"0 to {_GAIN_MAX:g}", where=where)


_LEAST, _GREATEST = 1e-40, 1e12
_GAIN_MAX = 4.0
"""d^2 + (a1 + g1) d + g2 has its roots inside the unit circle only for g1 and g2 within 4 (sampled, d = z - 1)."""
