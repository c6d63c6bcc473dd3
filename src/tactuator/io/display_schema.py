"""The tables of a display file, with every key and its default: what pydantic checks before anything is built."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from tactuator.errors import BadInput

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Positive = Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]
Pair = tuple[Number, Number]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid")


class PlantTable(_Table):
    """A plant as {num, den} in descending powers of s, or {zeros, poles, gain} (rad/s; a complex number is
    [re, im]).
    """

    num: list[Number] | None = None
    den: list[Number] | None = None
    zeros: list[Number | Pair] | None = None
    poles: list[Number | Pair] | None = None
    gain: Number | None = None
    delay_s: Annotated[float, Field(strict=True, ge=0.0, allow_inf_nan=False)] = 0.0


class ModelKeys(BaseModel):
    """Tables of a model file, beside its plant, that a display takes where they are there."""

    model_config = ConfigDict(extra="ignore")

    friction: dict[str, Number] | None = None
    family: list[PlantTable] = []
    covariance: list[list[Number]] = []


class CurveTable(_Table):
    """A curve with its points in place: how controller.json carries it."""

    name: str
    frequency_hz: list[Number]
    level_db_re_1um: list[Number]
    provenance: Literal["measured", "digitised", "inferred", "synthetic", "simulated"] = "digitised"
    source: str = ""
    standard_error_db: list[Number] | None = None


class LoadTable(_Table):
    """An impedance at the finger port, in the plant's own units."""

    name: str
    mass: Number = 0.0
    damping: Number = 0.0
    stiffness: Number = 0.0


class ConverterKeys(_Table):
    """Keys of [converter], each with its default."""

    bits: Whole = 16
    range_v: Number = 10.0
    polarity: Whole = 1
    offset_v: Number = 0.0


class ThresholdKeys(_Table):
    """Keys of [threshold]: a curve of the library, the path of a CSV, or a table."""

    curve: str | CurveTable = "bolanowski-1988"
    band_hz: Pair = (0.4, 300.0)


class FeedbackKeys(_Table):
    """Keys of [feedback], each with its default."""

    structure: Literal["integrator-lead-lag", "paper", "none"] = "integrator-lead-lag"
    phase_margin_deg: Positive | None = 50.0
    sensitivity_peak: Positive | None = 1.45
    mains_hz: list[Positive] = []
    mains_max_db: list[Number] = []
    rejection_hz: list[Positive] = []
    rejection_max_db: list[Number] = []
    command_noise_gain_max: Positive | None = 30.0
    rejection_band_hz: Pair = (0.4, 10.0)
    controller: PlantTable | None = None


class PrefilterKeys(_Table):
    """Keys of [prefilter], each with its default."""

    poles: Whole = 4
    falls_above_hz: Positive = 400.0


class EnvironmentKeys(_Table):
    """Keys of [environment]: hum and noise at the sensor, friction in volts of command.

    measured: a file that `noise --write` wrote, in place of hum_hz, hum_v_peak and noise_v_rms. assumed: which of them
    nobody has stated or measured; by default those whose key is not in the file.
    """

    hum_hz: list[Positive] = [60.0, 120.0, 180.0]
    hum_v_peak: list[Number] = [1.0e-3, 0.3e-3, 0.2e-3]
    noise_v_rms: Number = 0.2e-3
    friction_v: Number = 4.0e-3
    presliding_v: Positive = 10.0e-3
    measured: str | None = None
    assumed: list[Literal["hum", "noise", "friction"]] | None = None


class ObjectivesKeys(_Table):
    """Keys of [objectives], each with its default."""

    flatness_db: Positive = 1.0
    mains_max_db_sl: Number = 0.0
    noise_max_db_sl: Number = 0.0
    resonance_peak: Positive = 1.3
    load_max_db: Positive = 1.0
    load_band_hz: Positive = 10.0
    comfort_db_sl: Positive = 55.0


class TouchKeys(_Table):
    """Keys of [touch], each with its default."""

    adaptive: Annotated[bool, Field(strict=True)] = False


class DisplayKeys(_Table):
    """Keys of [display], each with its default."""

    name: str = "display"
    rate_hz: Number
    delay_samples: Whole = 1


class ForceKeys(_Table):
    """A sensor of the force that moves a known mass, in place of `sensor_gain_v_per_mm`."""

    mass_kg: Positive
    sensor_gain_v_per_n: Positive


class ChannelOwnKeys(_Table):
    """Keys that only a [[channel]] has."""

    name: str
    finger: str = ""
    sensor_gain_v_per_mm: Number
    travel_mm: Number
    plant: PlantTable | str
    quantity: Literal["displacement", "velocity", "acceleration"] = "displacement"
    loads: list[LoadTable] = []
    family: list[PlantTable] = []
    covariance: list[list[Number]] = []
    valid_hz: tuple[Positive, Positive] | None = None
    model_error_db: Annotated[float, Field(strict=True, ge=0.0, allow_inf_nan=False)] | None = None
    model_error_hz: tuple[Positive, Positive] | None = None


def require_travel_seen(own: ChannelOwnKeys, range_v: float, has_loop: bool, where: str) -> None:
    """Raise BadInput for a loop's sensor whose reading ends before the travel does: a gain or a travel in another unit,
    or a limit that the guard could not see.
    """
    farthest_v = own.travel_mm * own.sensor_gain_v_per_mm
    if has_loop and own.quantity == "displacement" and farthest_v > range_v:
        raise BadInput(
            f"{where} sensor_gain_v_per_mm: {own.sensor_gain_v_per_mm:g} V/mm make {farthest_v:.4g} V of travel_mm "
            f"{own.travel_mm:g}",
            f"up to range_v {range_v:g} V, beyond which nothing is read",
        )


class SoundKeys(_Table):
    """Keys of [sound] for the card as a whole, each with its default."""

    device: str = ""
    input_device: str = ""
    latency_samples: Whole = 0
    lead_s: Positive = 0.25


class WireKeys(_Table):
    """Keys of [sound] that may stand in a channel as well, and win there; output and input count from 1 in the order of
    the channels where nothing is said.
    """

    output: Whole | None = None
    input: Whole | None = None
    output_full_scale_v: Positive | None = None
    input_full_scale_v: Positive | None = None


SHARED_TABLES: dict[str, type[_Table]] = {
    "converter": ConverterKeys,
    "threshold": ThresholdKeys,
    "feedback": FeedbackKeys,
    "prefilter": PrefilterKeys,
    "environment": EnvironmentKeys,
}
"""Tables whose every key may stand in a channel as well, and wins there."""
