"""A display: channels with plants, sensors, converters, loads, what is asked of them; its tables, and their hash."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import field
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field
from pydantic.fields import FieldInfo

from tactuator.arrays import frequencies
from tactuator.errors import BadInput, unknown
from tactuator.model.plant import DERIVATIVES, Load, Quantity, System, motor_gain
from tactuator.model.requirements import (
    FeedbackRequirements,
    Objectives,
    PrefilterRequirements,
    SoundCard,
    Touch,
    Wires,
)
from tactuator.parameters import (
    HIGHEST_RATE_HZ,
    Band,
    Coefficient,
    Decibels,
    Flag,
    Hertz,
    Name,
    NotNegative,
    Number,
    Positive,
    Whole,
    Wording,
    parameters,
    table,
)
from tactuator.perception.contours import Contours
from tactuator.perception.curve import COMFORT_DB_SL, Contact, ThresholdCurve, threshold_chart
from tactuator.perception.curve import curve as library_curve
from tactuator.plain import brief, plain
from tactuator.result import Chart, Fact, Result, data, found
from tactuator.signals.decibels import from_db
from tactuator.signals.systems import ContinuousSystem


def document_hash(document: dict[str, Any]) -> str:
    """Return SHA-256 (hex) of a document without its own hash, in canonical JSON."""
    bare = {key: value for key, value in document.items() if key != "hash"}
    text = json.dumps(bare, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def display_document(display: Display) -> dict[str, Any]:
    """Return plain tables that `parse_display` makes an equal display of: curves with points, plants as roots."""
    wires = () if display.sound is None else display.sound.wires
    card = {} if display.sound is None else {"sound": _own(display.sound)}
    channels = [_channel_document(channel) for channel in display.channels]
    for channel, wire in zip(channels, wires, strict=bool(wires)):
        channel |= plain(wire)
    touch = {"touch": plain(display.touch)} if display.touch.adaptive else {}
    return {"display": _own(display), "objectives": plain(display.objectives), **card, **touch, "channel": channels}


def _own(table: Any) -> dict[str, Any]:
    """Return the keys that a table has in the file, without what other tables hold."""
    kind: type = type(table)
    return {key: plain(getattr(table, key)) for key in parameters(kind)}


_WHERE_SAID = (
    "contours",
    "covariance",
    "valid_hz",
    "model_error_db",
    "model_error_hz",
    "controller",
    "models",
    "recorded",
    "unchanged",
)
"""Keys of a channel that are left out where nothing is said."""


def _channel_document(channel: Channel) -> dict[str, Any]:
    given, threshold = channel.feedback.controller, plain(channel.threshold)
    if not channel.threshold.curve.contact.said:
        del threshold["curve"]["contact"]
    if channel.threshold.curve.bound is None:
        del threshold["curve"]["bound"]
    tables: dict[str, Any] = {
        **_own(channel),
        **plain(channel.converter),
        **threshold,
        **plain(channel.feedback),
        **plain(channel.prefilter),
        **plain(channel.environment),
        **(plain(channel.strength) if channel.strength != Strength() else {}),
        **{key: plain(getattr(channel.contact, key)) for key in channel.contact.said},
        "loads": [{key: value for key, value in plain(load).items() if value is not None} for load in channel.loads],
        "plant": _system_document(channel.plant),
        "family": [_system_document(member) for member in channel.family],
        "controller": None if given is None else _system_document(given),
    }
    return {key: value for key, value in tables.items() if value or key not in _WHERE_SAID}


def _system_document(system: ContinuousSystem) -> dict[str, Any]:
    return {
        "zeros": [[root.real, root.imag] for root in system.zeros.tolist()],
        "poles": [[root.real, root.imag] for root in system.poles.tolist()],
        "gain": system.gain,
        "delay_s": system.delay_s,
    }


KNOWN_EDGE = 1.05
"""A frequency within this factor of `valid_hz` counts as known."""


@table("[converter]")
class Converter:
    """A/D and D/A alike, over +/- range_v."""

    bits: Annotated[Whole, Field(ge=8, le=24, description="of A/D and D/A")] = 16
    range_v: Annotated[Positive, Field(description="+/- volts")] = 10.0
    polarity: Annotated[
        Literal[1, -1], Wording("1 or -1"), Field(description="`-1` if a positive command moves the sensor down")
    ] = 1
    offset_v: Annotated[Number, Field(description="offset of the command at the motor")] = 0.0

    def __post_init__(self) -> None:
        if not abs(self.offset_v) < self.range_v:
            raise BadInput(f"{self.offset_v:g}", f"within +/- {self.range_v:g} V", key="offset_v")

    @property
    def step_v(self) -> float:
        """Return one converter step, volts: the range over 2^bits codes."""
        return 2.0 * self.range_v / 2.0**self.bits


@table("[threshold]")
class Threshold:
    """The curve a channel is to follow, over band_hz."""

    curve: Annotated[
        ThresholdCurve,
        Wording(
            "a name, the path of a CSV (`frequency_hz,level_db_re_1um`), or a table with the points",
            '"bolanowski-1988"',
            "a ThresholdCurve (`tt.read_curve` returns one)",
        ),
        Field(
            description="a curve of the library (`bolanowski-1988`: inferred, thenar eminence; `morioka-griffin-2006`: "
            "digitised, hand on a handle), or your own"
        ),
    ] = field(default_factory=partial(library_curve, "bolanowski-1988"))
    band_hz: Annotated[Band, Field(description="where the response follows the curve, which must cover it")] = (
        0.4,
        300.0,
    )

    __repr__ = brief

    def __post_init__(self) -> None:
        low, high = self.band_hz
        if not self.curve.covers(low, high):
            first, last = self.curve.frequency_hz[[0, -1]]
            raise BadInput(
                f"curve {self.curve.name!r} reaches from {first:g} to {last:g} Hz",
                f"one that covers the band of {low:g} to {high:g} Hz",
            )


@table("[strength]")
class Strength:
    """What equal references are: equally far above threshold, or, where contours are named, equally strong."""

    contours: Annotated[
        Contours | None,
        Wording(
            "the path of a CSV (`level_db_sl,frequency_hz,db_sl`), or a table with the points", in_python="Contours"
        ),
        Field(
            description="equal-strength contours; references of one level are then equally strong, and without "
            "contours equally far above threshold"
        ),
    ] = None
    strength_db_sl: Annotated[
        NotNegative, Field(le=COMFORT_DB_SL, description="level of the contour that the prefilter follows")
    ] = 30.0
    blended: Annotated[
        Flag,
        Field(description="follow the contour of the reference's own short-time level instead of `strength_db_sl`"),
    ] = False
    balance_db: Annotated[
        Number,
        Field(ge=-20.0, le=20.0, description="gain of this finger, so that all fingers feel a reference alike"),
    ] = 0.0

    __repr__ = brief

    def __post_init__(self) -> None:
        if self.blended and self.contours is None:
            raise BadInput("true, while no contours are named", "contours, or false", key="blended")

    def asked_db_sl(self, level_db_sl: ArrayLike, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Return the sensation level that a reference of `level_db_sl` asks for at `frequency_hz`; they broadcast."""
        if self.contours is None:
            level, _ = np.broadcast_arrays(np.asarray(level_db_sl, dtype=np.float64), frequency_hz)
            return np.asarray(level + self.balance_db)
        return self.contours.level_db_sl_at(level_db_sl, frequency_hz) + self.balance_db


Disturbance = Literal["hum", "noise", "friction", "presliding"]
DISTURBANCES: tuple[Disturbance, ...] = get_args(Disturbance)
_UNSTATED: tuple[Disturbance, ...] = ("hum", "noise", "friction")
"""What is assumed of a channel that states no environment; a presliding distance rests on its friction."""


@table("[environment]")
class Environment:
    """Disturbances of a channel: hum, white sensor noise, Dahl friction.

    The simulated display has these values; the verdict is judged by them, and reports what depends on assumed ones.
    """

    hum_hz: Annotated[tuple[Hertz, ...], Field(description="lines of hum at the sensor")] = (60.0, 120.0, 180.0)
    hum_v_peak: Annotated[tuple[NotNegative, ...], Field(description="their peak voltages at the sensor")] = (
        1.0e-3,
        0.3e-3,
        0.2e-3,
    )
    noise_v_rms: Annotated[NotNegative, Field(description="white noise at the sensor")] = 0.2e-3
    friction_v: Annotated[NotNegative, Field(description="Coulomb friction, in volts of command")] = 4.0e-3
    presliding_v: Annotated[Positive, Field(description="presliding distance (Dahl), in sensor volts")] = 10.0e-3
    assumed: Annotated[
        tuple[Disturbance, ...],
        Wording(default="what has no key here"),
        Field(description="values that were neither stated nor measured; reported, not judged"),
    ] = ()

    def __post_init__(self) -> None:
        if len(self.hum_hz) != len(self.hum_v_peak):
            raise BadInput(f"{len(self.hum_hz)} hum_hz and {len(self.hum_v_peak)} hum_v_peak", "as many of each")

    @property
    def mains_hz(self) -> float:
        """Return the lowest line of hum; 0 for none."""
        return min(self.hum_hz, default=0.0)


@table("[environment]")
class MeasuredEnvironment:
    """A file of figures in place of those of [environment]."""

    measured: Annotated[
        str | None,
        Wording("the path of a file"),
        Field(description="a file of `measure noise --write`; replaces `hum_hz`, `hum_v_peak` and `noise_v_rms`"),
    ] = None


_IN_PLACE = Wording(default="none")


@table("[[channel]]")
class ForceSensor:
    """A sensor of the force that moves a known mass, in place of `sensor_gain_v_per_mm`."""

    mass_kg: Annotated[Positive, _IN_PLACE, Field(description='only with `quantity = "force"`: the moving mass')]
    sensor_gain_v_per_n: Annotated[
        Positive, _IN_PLACE, Field(description='only with `quantity = "force"`, in place of `sensor_gain_v_per_mm`')
    ]


@table("recorded")
class Recorded:
    """The record that a plant was identified from, as far as it is known. command, position: half their spans;
    remarks: on how it was read.
    """

    rate_hz: Positive | None = None
    command: NotNegative | None = None
    position: NotNegative | None = None
    position_unit: str = ""
    distrust: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


@table("[[channel]]")
class Channel:
    """The actuator of one finger.

    plant: command (V) to sensor voltage (V). family: other plants that fit the record; a design must hold for them too.
    covariance: as `identify` found it; empty: unknown. valid_hz: None for everywhere.

    A plant may also be (num, den), or a continuous linear system of python-control or scipy.signal. Loads without
    `per` are relative to its moving mass, whatever `den` begins with.

    >>> tt.Channel("index", sensor_gain_v_per_mm=0.2, travel_mm=12.5, plant=([2875.0], [1.0, 94.0, 290.0])).finger
    'index'
    """

    name: Annotated[Name, Field(description="unique name")]
    sensor_gain_v_per_mm: Annotated[
        Positive,
        Field(
            description="volts of the sensor per mm (or mm/s, mm/s², by `quantity`); a model in mm is converted by it"
        ),
    ]
    travel_mm: Annotated[Positive, Field(description="mechanical limit, +/-")]
    plant: Annotated[
        System,
        Wording(
            "`{ num, den }`, `{ zeros, poles, gain }`, the path of a file, or a list of paths",
            in_python="(num, den), a table { zeros, poles, gain }, or a system of python-control or scipy.signal",
        ),
        Field(
            description="command volts to sensor volts: `num` and `den` in descending powers of s, `zeros` and `poles` "
            "in rad/s (complex roots as `[re, im]`), optionally `delay_s`; or a `model.json` of `identify`, or a list "
            "of them, of which the first is the nominal one; with "
            '`structure = "none"` also a response (`frequency_hz` with `magnitude` or `magnitude_db`, no phase), whose '
            "columns `{ file, frequency, magnitude, ... }` names as `identify` does"
        ),
    ]
    finger: Annotated[Name, Wording(default="the name"), Field(description="whose finger")] = ""
    threshold: Threshold = field(default_factory=Threshold)
    quantity: Annotated[
        Quantity,
        Wording('"displacement", "velocity", "acceleration", or "force" on a known mass'),
        Field(description="what the sensor measures"),
    ] = "displacement"
    loads: Annotated[
        tuple[Load, ...],
        Field(
            description="what can touch it: `name`, `mass`, `damping`, `stiffness` of an impedance Z = (mass·s² + "
            "damping·s + stiffness)/per in command volts per sensor volt, with which P becomes P/(1 + PZ); `per` is "
            "the gain of a motor gain/(s² + bs + k), where kg, N·s/m and N/m are divided by the moving mass; for any "
            "other plant, state it"
        ),
    ] = ()
    converter: Converter = field(default_factory=Converter)
    feedback: FeedbackRequirements = field(default_factory=FeedbackRequirements)
    prefilter: PrefilterRequirements = field(default_factory=PrefilterRequirements)
    environment: Environment = field(default_factory=lambda: Environment(assumed=_UNSTATED))
    strength: Strength = field(default_factory=Strength)
    contact: Contact = field(default_factory=Contact)
    family: Annotated[
        tuple[System, ...],
        Field(description="other plants that fit the record; a design holds for them too"),
    ] = ()
    models: Annotated[
        tuple[str, ...],
        Wording(default="the names of the files, where `plant` is a list"),
        Field(description="names of the models that `plant` and each of `family` belong to"),
    ] = ()
    covariance: Annotated[
        tuple[tuple[Coefficient, ...], ...],
        Wording("a list of rows"),
        Field(
            description="of the plant's `num`, its monic `den` after the leading one, and its `delay_s`; set by a "
            "`model.json`"
        ),
    ] = ()
    valid_hz: Annotated[
        Band | None,
        Wording(default="everywhere"),
        Field(
            description="where the plant is known (set by a `model.json` or response). Outside, nothing is judged and, "
            "without a loop, nothing equalised"
        ),
    ] = None
    model_error_db: Annotated[
        Decibels, Field(ge=0.0, description="error of the plant's magnitude (set by a response)")
    ] = 0.0
    model_error_hz: Annotated[Band | None, Field(description="where this error is greatest (set by a response)")] = None
    recorded: Annotated[
        Recorded | None,
        Wording(default="none"),
        Field(
            description="the plant's record (set by a `model.json`): `rate_hz`, amplitudes of `command` and "
            "`position`, `position_unit`, and `distrust`, why not to trust the plant"
        ),
    ] = None
    unchanged: Annotated[
        tuple[str, ...],
        Wording(default="the keys whose line says CHANGE THIS"),
        Field(description="keys that still have the template's value; what they decide is not judged"),
    ] = ()

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "finger", self.finger or self.name)
        zeros, poles = self.plant.zeros.size, self.plant.poles.size
        size = zeros + poles + 2
        if self.covariance and {len(self.covariance), *(len(row) for row in self.covariance)} != {size}:
            raise BadInput(f"of {len(self.covariance)} rows", f"{size} rows of {size}", key="covariance")
        if self.models and len(self.models) != 1 + len(self.family):
            raise BadInput(f"{len(self.models)} names", f"{1 + len(self.family)}, of plant and family", key="models")
        if len({load.name for load in self.loads}) != len(self.loads):
            raise BadInput("two loads have the same name", "each name once")
        for load in self.loads:
            if not (load.mass or load.damping or load.stiffness):
                raise BadInput(f"load {load.name!r} is all zero", "a mass, damping or stiffness above zero")

    def is_known(self, frequency_hz: ArrayLike) -> NDArray[np.bool_]:
        """Return, for each frequency, whether the plant is known there; edges count within rounding."""
        frequency = frequencies(frequency_hz)
        low, high = self.valid_hz or (0.0, np.inf)
        return np.asarray((frequency >= low / KNOWN_EDGE) & (frequency <= high * KNOWN_EDGE))

    @property
    def known_words(self) -> str:
        """Return from where to where the plant is known, as a person reads it."""
        low, high = self.valid_hz or (0.0, np.inf)
        return f"the plant is known from {low:.4g} to {high:.4g} Hz only (valid_hz)"

    @property
    def unknown_words(self) -> str:
        """Return what part of the band lies beyond what is known of the plant; empty where none does."""
        low, high = self.threshold.band_hz
        whole = np.all(self.is_known([low, high]))
        return "" if whole else f"band_hz is [{low:g}, {high:g}], but {self.known_words}"

    def contact_notices(self) -> Iterator[str]:
        """Yield where the curve or the contours were felt otherwise than the channel is, and what of the curve is not
        known, in sentences.
        """
        curve, contours = self.threshold.curve, self.strength.contours
        if curve.bounds_said:
            yield f"{self.name}: the threshold curve {curve.name} is {curve.bounds_said}"
        given = [(f"the threshold curve {curve.name} was", curve.contact)]
        if contours is not None:
            given.append((f"the contours {contours.name} were", contours.contact))
        for noun, contact in given:
            for key, mine, theirs in self.contact.differences(contact):
                yield f"{self.name}: {noun} not felt alike: {key} {theirs}; the display's is {mine}"

    def load(self, name: str) -> Load:
        """Return the load of that name. Raises BadInput for an unknown name."""
        for load in self.loads:
            if load.name == name:
                return load
        known = [load.name for load in self.loads] or ["none is described"]
        raise unknown("load", name, known, where=(f"channel {self.name!r}",))

    def loaded_plant(self, load: Load | None) -> ContinuousSystem:
        """Return the plant under `load`; for None, the plant without load."""
        return self.under(load, self.plant)

    def under(self, load: Load | None, plant: ContinuousSystem) -> ContinuousSystem:
        """Return one of the plants under `load`, whose scale is that of the nominal plant; for None, the plant."""
        return plant if load is None else load.applied_to(plant, self.quantity, self.plant)

    def impedance(self, load: Load) -> NDArray[np.float64]:
        """Return the coefficients of a load's Z, (3,). Raises BadInput where its scale is missing."""
        return load.impedance(self.plant, self.quantity)

    @property
    def is_motor(self) -> bool:
        """Tell whether the plant is of the form whose gain is the scale of loads."""
        return motor_gain(self.plant, self.quantity) is not None

    @property
    def load_scale(self) -> float:
        """Return the scale in which an estimated load is written: the motor's gain, or else that of the loads."""
        stated = next((load.per for load in self.loads if load.per), 1.0)
        return motor_gain(self.plant, self.quantity) or stated

    def threshold_voltage(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Return the |H| that the curve asks for: peak volts of y at threshold (r = 1); any shape."""
        frequency = frequencies(frequency_hz)
        speed = (2.0 * np.pi * frequency) ** DERIVATIVES[self.quantity]
        return self.sensor_gain_v_per_mm * self.threshold.curve.displacement_mm(frequency) * speed

    def asked_voltage(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Return the |H| that is asked for, peak volts of y for r = 1, at `frequency_hz` (any shape), at the strength
        that the prefilter is made for: the threshold voltage, or off it by what the contours and the balance say.
        """
        level = self.strength.strength_db_sl
        return self.threshold_voltage(frequency_hz) * from_db(self.strength.asked_db_sl(level, frequency_hz) - level)

    def prefilter_voltage(self, frequency_hz: ArrayLike) -> NDArray[np.float64]:
        """Return the part of `asked_voltage` that the prefilter gives: all of it, or what blending leaves."""
        if self.strength.blended:
            return self.threshold_voltage(frequency_hz) * from_db(self.strength.balance_db)
        return self.asked_voltage(frequency_hz)


@table("[display]")
class Display(Result):
    """Channels that share one rate and one computing delay. sound: their wiring to a sound card, or None.

    It draws the threshold curve of every channel. What is not given is as in a display file.

    >>> motor = tt.Channel("index", sensor_gain_v_per_mm=0.2, travel_mm=12.5, plant=([2875.0], [1.0, 94.0, 290.0]))
    >>> tt.Display(rate_hz=4000.0, channels=(motor,)).delay_samples
    1
    """

    rate_hz: Annotated[
        Positive,
        Field(le=HIGHEST_RATE_HZ, description="sampling rate, at least four times the highest frequency of the band"),
    ]
    channels: tuple[Channel, ...]
    delay_samples: Annotated[
        Whole,
        Field(ge=0, le=8, description="periods from reading the sensor to the output of the resulting command"),
    ] = 1
    name: Annotated[str, Field(description="its name in reports")] = "display"
    objectives: Objectives = field(default_factory=Objectives)
    sound: SoundCard | None = None
    touch: Touch = field(default_factory=Touch)

    in_words: ClassVar[str] = (
        "a Display (tt.read_display reads a file; of a plant: tt.Display(rate_hz, [tt.Channel(..., plant=plant)]))"
    )

    __repr__ = Result.__repr__

    def __post_init__(self) -> None:
        if not self.channels:
            raise BadInput("no channel", "one or more")
        if len({channel.name for channel in self.channels}) != len(self.channels):
            raise BadInput("two channels have the same name", "each name once")
        if self.sound is not None and len(self.sound.wires) != len(self.channels):
            raise BadInput(f"{len(self.sound.wires)} wires for {len(self.channels)} channels", "one for each")
        for channel in self.channels:
            high = channel.threshold.band_hz[1]
            if self.rate_hz < 4.0 * high:
                raise BadInput(
                    f"{self.rate_hz:g} for a band up to {high:g} Hz", f"{4.0 * high:g} or more", key="rate_hz"
                )

    def facts(self) -> Sequence[Fact]:
        """Return name, rate, channels and curves, and the keys of the file."""
        curves = dict.fromkeys(channel.threshold.curve.name for channel in self.channels)
        return [
            found("name", self.name),
            found("rate", self.rate_hz, "Hz"),
            found("channels", ", ".join(channel.name for channel in self.channels)),
            found("curve", ", ".join(curves)),
            *data(display_document(self)),
        ]

    def chart(self) -> Chart:
        """Return the threshold curves, each with the channels that have it."""
        curves = {channel.threshold.curve.name: channel.threshold.curve for channel in self.channels}
        names = {name: [c.name for c in self.channels if c.threshold.curve.name == name] for name in curves}
        labelled = {f"{', '.join(names[name])}: {name}": curve for name, curve in curves.items()}
        return threshold_chart(labelled, self.objectives.comfort_db_sl)

    def channel(self, name: str) -> Channel:
        """Return the channel of that name. Raises BadInput for an unknown name."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise unknown("channel", name, [channel.name for channel in self.channels], where=("display",))

    def mains_hz(self, asked: float | None, usual: float) -> float:
        """Return the mains to keep off: what is asked for, else the lowest line of hum that a file states, else the
        usual.
        """
        stated = (channel.environment for channel in self.channels if "hum" not in channel.environment.assumed)
        return asked if asked is not None else next(filter(None, (each.mains_hz for each in stated)), usual)


SHARED_TABLES: dict[str, tuple[type, ...]] = {
    "converter": (Converter,),
    "threshold": (Threshold,),
    "feedback": (FeedbackRequirements,),
    "prefilter": (PrefilterRequirements,),
    "environment": (Environment, MeasuredEnvironment),
    "strength": (Strength,),
    "contact": (Contact,),
}
"""Tables of a display file whose keys may also be set in a channel, where they take precedence."""
TABLES: dict[str, tuple[type, ...]] = {
    "display": (Display,),
    "channel": (Channel, ForceSensor),
    **SHARED_TABLES,
    "objectives": (Objectives,),
    "touch": (Touch,),
    "sound": (SoundCard, Wires),
}
"""Tables of a display file, by name, with the dataclasses whose parameters are their keys."""


def keys_of(name: str) -> dict[str, FieldInfo]:
    """Return the keys of a table of the display file, by name."""
    return {key: about for part in TABLES[name] for key, about in parameters(part).items()}
