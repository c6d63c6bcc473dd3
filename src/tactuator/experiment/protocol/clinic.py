"""What a clinic asks of a sitting: limits for the day's skin and contact, and a standard's conditions to be compared.

The limits of ISO 13091-1 are not free, and none of them is written here: a laboratory copies those of its own copy into
its protocol. What it does not give is told as not compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from tactuator.errors import BadInput
from tactuator.parameters import NotNegative, Positive, Seconds, table
from tactuator.perception.curve import Contact

Celsius = Annotated[Positive, Field(lt=50.0)]


@dataclass(frozen=True)
class Unmet:
    """A condition that is not met; got, allowed: in words and numbers ("" where nothing was given)."""

    condition: str
    got: str
    allowed: str

    def __str__(self) -> str:
        return (
            f"{self.condition}: {self.got or 'not given'} (allowed: {self.allowed or 'no limit given, not compared'})"
        )


def outside(
    condition: str, value: float | None, low: float | None, high: float | None, unit: str, unstated: bool = False
) -> list[Unmet]:
    """Return what is not met by a value within limits, none where there is no limit; unstated: that is told as well."""
    if low is None and high is None:
        return [Unmet(condition, "" if value is None else f"{value:g} {unit}", "")] if unstated else []
    inside = value is not None and (low is None or value >= low) and (high is None or value <= high)
    allowed = " to ".join(f"{limit:g}" for limit in (low, high) if limit is not None)
    which = "" if low is not None and high is not None else "at least " if high is None else "at most "
    got = "" if value is None else f"{value:g} {unit}"
    return [] if inside else [Unmet(condition, got, f"{which}{allowed} {unit}")]


def _in_order(limits: Mapping[str, Any]) -> None:
    for name, low in limits.items():
        high = limits.get(name.replace("_low_", "_high_"))
        if "_low_" in name and low is not None and high is not None and low > high:
            raise BadInput(f"{name} {low:g} is above {high:g}", "a low limit up to the high one")


@table("[gates]")
class Gates:
    """Keys of [gates]: limits of what the experimenter notes on the day, before a run may begin."""

    outside: Annotated[
        Literal["refuse", "tell"], Field(description="what is outside: no run begins, or an event tells it")
    ] = "refuse"
    skin_temperature_low_c: Annotated[Celsius | None, Field(description="least temperature of the skin")] = None
    skin_temperature_high_c: Annotated[Celsius | None, Field(description="highest temperature of the skin")] = None
    preload_low_n: Annotated[NotNegative | None, Field(description="least force of contact")] = None
    preload_high_n: Annotated[NotNegative | None, Field(description="greatest force of contact")] = None
    posture: Annotated[str, Field(max_length=200, description="posture that the experimenter confirms")] = ""

    def __post_init__(self) -> None:
        _in_order(vars(self))

    def unmet(self, skin_temperature_c: float | None, preload_n: float | None, posture: str) -> list[Unmet]:
        """Return what the day's data do not meet."""
        unmet = outside(
            "skin_temperature_c", skin_temperature_c, self.skin_temperature_low_c, self.skin_temperature_high_c, "°C"
        )
        unmet += outside("preload_n", preload_n, self.preload_low_n, self.preload_high_n, "N")
        if self.posture and posture != self.posture:
            unmet.append(Unmet("posture", posture, self.posture))
        return unmet


@table("[standard]")
class StandardConditions:
    """Keys of [standard]: conditions of a standard, from your own copy: protocol and display are compared."""

    name: Annotated[str, Field(min_length=1, max_length=100, description="of the standard")] = "ISO 13091-1"
    source: Annotated[str, Field(max_length=200, description="copy that the limits are from")] = ""
    frequencies_hz: Annotated[tuple[Positive, ...], Field(description="frequencies that it asks for")] = (
        4.0,
        31.5,
        125.0,
    )
    contact_low_mm2: Annotated[Positive | None, Field(description="least area of contact")] = None
    contact_high_mm2: Annotated[Positive | None, Field(description="greatest area of contact")] = None
    surround: Annotated[str | None, Field(description="surround of the contactor")] = None
    ramp_low_s: Annotated[Seconds | None, Field(description="shortest ramp")] = None
    ramp_high_s: Annotated[Seconds | None, Field(description="longest ramp")] = None
    stimulus_low_s: Annotated[Seconds | None, Field(description="shortest stimulus")] = None
    stimulus_high_s: Annotated[Seconds | None, Field(description="longest stimulus")] = None

    def __post_init__(self) -> None:
        _in_order(vars(self))

    def unmet(
        self,
        frequencies_hz: Sequence[float],
        contact_mm2: float | None,
        surround: str,
        ramp_s: float,
        stimulus_s: float,
    ) -> list[Unmet]:
        """Return each condition that a protocol does not meet, and each that nothing could be compared with."""
        missing = [f"{hertz:g}" for hertz in self.frequencies_hz if hertz not in frequencies_hz]
        unmet = [Unmet("frequency", "none", f"{hertz} Hz") for hertz in missing]
        unmet += outside("contact area", contact_mm2, self.contact_low_mm2, self.contact_high_mm2, "mm²", True)
        if self.surround is None or surround != self.surround:
            unmet.append(Unmet("surround", surround, self.surround or ""))
        unmet += outside("ramp", ramp_s, self.ramp_low_s, self.ramp_high_s, "s", True)
        return unmet + outside("stimulus", stimulus_s, self.stimulus_low_s, self.stimulus_high_s, "s", True)

    def unmet_by(self, contact: Contact, band_hz: tuple[float, float], ramp_s: Mapping[float, float]) -> list[Unmet]:
        """Return each condition that is not met. contact: where a finger is. ramp_s: at each frequency."""
        low, high = band_hz
        beyond = [hertz for hertz in self.frequencies_hz if not low <= hertz <= high]
        unmet = [Unmet("the display's band", f"{low:g} to {high:g} Hz", f"{hertz:g} Hz within it") for hertz in beyond]
        limits = self.contact_low_mm2, self.contact_high_mm2
        unmet += outside("the display's contact area", contact.area_mm2, *limits, "mm²")
        if self.surround is not None and contact.surround != self.surround:
            unmet.append(Unmet("the display's surround", contact.surround, self.surround))
        for hertz, ramp in ramp_s.items():
            unmet += outside(f"the ramp at {hertz:g} Hz", ramp, self.ramp_low_s, self.ramp_high_s, "s")
        return unmet
