"""Things that a user knows or wishes of the model that is identified: each with its default, bounds and sentence."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_type_hints

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from tactuator.errors import BadInput
from tactuator.identification.form import MOST_POLES, Known, Pin, Section
from tactuator.model.plant import DERIVATIVES
from tactuator.model.plant_model import PlantModel

NAMES = ("gain", "stiffness", "mass", "pole", "resonance", "num_sK", "den_sK")
_COEFFICIENT = re.compile(r"(num|den)_s([0-8])")


@contextmanager
def solvable() -> Iterator[None]:
    """Refuse what leaves a step of linear algebra without an answer, whichever step it is."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise BadInput(f"no model can be told from it ({error})", "a position that the command moves") from None


@dataclass(frozen=True)
class Fixed:
    """A value that is known, by one of these names.

    - gain: position over command at zero frequency; stiffness: its inverse, command over position;
    - mass: command over acceleration at high frequency (kilograms where the command is in newtons, the position in
      metres), of a mechanism of two poles more than zeros;
    - pole: of a low-pass of first order, hertz; resonance: of a pair of poles, hertz, with `q`;
    - num_s0, num_s1, .. den_s0, ..: a coefficient as model.json has it, descending powers of s, denominator monic.
    """

    name: str
    value: float
    q: float = 0.0

    def __post_init__(self) -> None:
        if self.name not in NAMES[:5] and not _COEFFICIENT.fullmatch(self.name):
            raise BadInput(f"fixed {self.name!r}", f"{', '.join(NAMES)}")
        if not (math.isfinite(self.value) and math.isfinite(self.q)):
            raise BadInput(f"fixed {self}", "a finite number")
        if self.name == "gain" and self.value == 0.0:
            raise BadInput(f"fixed {self}", "other than zero")
        if self.name != "gain" and not self.name.startswith("num") and self.value <= 0.0:
            raise BadInput(f"fixed {self}", "above zero (poles lie in the left half plane)")
        if self.name == "resonance" and self.q <= 0.0:
            raise BadInput(f"fixed {self}", "a Q above zero, resonance=HERTZ,Q")

    def __str__(self) -> str:
        return f"{self.name}={self.value:g}" + (f",{self.q:g}" if self.name == "resonance" else "")

    @classmethod
    def parse(cls, text: str) -> Fixed:
        """Return the value of a text NAME=VALUE, or resonance=HERTZ,Q. Raises BadInput."""
        name, equals, rest = text.partition("=")
        values = rest.split(",")
        try:
            numbers = [float(number) for number in values]
        except ValueError:
            numbers = []
        if not equals or len(numbers) != (2 if name.strip() == "resonance" else 1):
            raise BadInput(f"fixed {text!r}", f"NAME=VALUE or resonance=HERTZ,Q, names: {', '.join(NAMES)}")
        return cls(name.strip(), *numbers)

    @property
    def power(self) -> int:
        """Return the power of s of a coefficient."""
        return int(self.name[-1])

    @property
    def section(self) -> Section:
        """Return the section of a known pole or resonance, monic, rad/s; nothing for any other."""
        omega = 2.0 * math.pi * self.value
        if self.name == "pole":
            return (omega,)
        return (omega / self.q, omega**2) if self.name == "resonance" else ()

    def pin(self, ratio: float) -> Pin | None:
        """Return what it pins, of time in seconds and of a response in units of `ratio`; None for a pole."""
        if self.name in ("gain", "stiffness"):
            return Pin("gain", 0, (self.value if self.name == "gain" else 1.0 / self.value) / ratio)
        if self.name == "mass":
            return Pin("lead", 2, 1.0 / self.value / ratio)
        if self.name.startswith("num"):
            return Pin("num", self.power, self.value / ratio)
        return Pin("den", self.power, self.value) if self.name.startswith("den") else None

    def of_model(self, model: PlantModel) -> tuple[float, float] | None:
        """Return the same value of another model and its 95 % half-width (nan: not known), None where that has none."""
        confidence = model.confidence()
        n, m = model.den.size - 1, model.num.size - 1
        if self.name in ("gain", "stiffness") and model.den[-1] != 0.0 and model.num[-1] != 0.0:
            gain, half = float(model.num[-1] / model.den[-1]), confidence["gain"]
            return (gain, half) if self.name == "gain" else (1.0 / gain, half / gain**2)
        if self.name == "mass" and n - m == 2:
            lead = float(model.num[0])
            return 1.0 / lead, confidence[f"num_s{m}"] / lead**2
        if _COEFFICIENT.fullmatch(self.name):
            values = model.num if self.name.startswith("num") else model.den
            if self.name not in confidence:
                return None
            return float(values[values.size - 1 - self.power]), confidence[self.name]
        if self.section:
            size = np.abs(np.roots(model.den)) / (2.0 * np.pi)
            return float(size[np.argmin(np.abs(np.log(np.maximum(size, 1e-300) / self.value)))]), float("nan")
        return None


def contradiction(
    fixed: Sequence[Fixed], order: int | None, zeros: int | None, integrators: int, origin_zeros: int
) -> str | None:
    """Return why values cannot be fixed together, or beside the form that is asked for; None where they can."""
    names = [value.name for value in fixed if not value.section]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        return f"{twice[0]} is fixed twice"
    known = integrators + sum(len(value.section) for value in fixed)
    if known > (order or MOST_POLES):
        return f"{known} poles are known of {order or MOST_POLES}"
    if "gain" in names and "stiffness" in names:
        return "gain and stiffness are one value"
    if {"gain", "stiffness"} & set(names) and (integrators or origin_zeros):
        return "a gain at zero frequency beside poles or zeros at s = 0"
    if "mass" in names and None not in (order, zeros) and order - zeros != 2:  # type: ignore[operator]
        return f"a mass with {order} poles and {zeros} zeros: it has two poles more than zeros"
    coefficients = [value for value in fixed if _COEFFICIENT.fullmatch(value.name)]
    if coefficients and order is None:
        return f"{coefficients[0].name} without --order: what it means depends on the number of poles"
    for value in coefficients:
        top = order if value.name.startswith("den") else zeros if zeros is not None else order
        least, most = (integrators, order - 1) if value.name.startswith("den") else (origin_zeros, top)  # type: ignore[operator]
        if not least <= value.power <= most:  # type: ignore[operator]
            return f"{value.name} of {order} poles; allowed powers: {least} to {most}"
    if {"num_s0", "den_s0"} <= set(names) and {"gain", "stiffness"} & set(names):
        return "num_s0, den_s0 and a gain: two of them give the third"
    if "mass" in names and order is not None and f"num_s{order - 2}" in names:
        return f"mass and num_s{order - 2} are one value"
    if order is not None and sum(name.startswith("den") for name in names) > order - known:
        return "more coefficients of the denominator than poles that are free"
    return None


@dataclass(frozen=True)
class Asked:
    """Things known or wished beforehand. Raises BadInput for what is out of bounds or contradicts itself."""

    order: Annotated[int | None, Field(ge=1, le=MOST_POLES, description="Number of poles (default: chosen).")] = None
    zeros: Annotated[int | None, Field(ge=0, le=MOST_POLES, description="Number of zeros (default: chosen).")] = None
    integrators: Annotated[int, Field(ge=0, le=MOST_POLES, description="Poles known to lie at s = 0.")] = 0
    delay_s: Annotated[
        float | None,
        Field(ge=0.0, allow_inf_nan=False, description="Dead time, where it is known (default: estimated)."),
    ] = None
    hold: Annotated[
        Literal["auto", "zero-order", "first-order", "band-limited"],
        Field(
            description="The command between its samples: zero-order, first-order (held by a converter), band-limited "
            "(recorded through an anti-aliasing filter), or auto: the record tells."
        ),
    ] = "auto"
    quantity: Annotated[
        Literal["auto", "displacement", "velocity", "acceleration"],
        Field(description="What the position is: displacement, velocity, acceleration, or auto: the record says it."),
    ] = "auto"
    friction: Annotated[bool, Field(description="Estimate friction.")] = True
    fixed: Annotated[
        tuple[Fixed, ...],
        Field(
            description="A value that is known, NAME=VALUE; may be repeated: gain (position over command at 0 Hz), "
            "stiffness (its inverse), mass (command over acceleration), pole=HERTZ, resonance=HERTZ,Q, num_sK and "
            "den_sK (coefficients as in the model file)."
        ),
    ] = ()
    method: Annotated[
        Literal["refined", "rls"],
        Field(description="refined (maximum likelihood), rls (the paper's recursive least squares)."),
    ] = "refined"
    forgetting: Annotated[float, Field(gt=0.0, le=1.0, description="Of the recursion; 1 keeps everything.")] = 1.0

    def __post_init__(self) -> None:
        for name, (annotation, check) in _checks().items():
            value = getattr(self, name)
            try:
                check.validate_python(value, strict=True)
            except ValidationError:
                raise BadInput(f"{value!r}", _allowed(annotation), key=name) from None
        origin_zeros, most = DERIVATIVES.get(self.quantity, 0), MOST_POLES if self.order is None else self.order
        if self.method == "refined" and most < origin_zeros:
            raise BadInput(f"{most} for the {self.quantity}", f"{origin_zeros} to {MOST_POLES}", key="order")
        if self.zeros is not None and not origin_zeros <= self.zeros <= most:
            raise BadInput(f"{self.zeros}", f"{origin_zeros} to {most}", key="zeros")
        if self.integrators > most:
            raise BadInput(f"{self.integrators}", f"0 to {most}", key="integrators")
        against = contradiction(self.fixed, self.order, self.zeros, self.integrators, origin_zeros)
        if against is not None:
            raise BadInput(f"{against}", "values that do not contradict each other or the form")
        if self.method != "refined" and self.fixed:
            raise BadInput(f"fixed values with the method {self.method!r}", "with 'refined' alone")

    def of(self, about: Mapping[str, str]) -> Asked:
        """Return the same for a record of which that is told: its quantity, where none was asked for."""
        if self.quantity != "auto":
            return self
        stated = about.get("quantity", "")
        return replace(self, quantity=stated if stated in DERIVATIVES else "displacement")  # type: ignore[arg-type]

    def known(self, ratio: float) -> Known:
        """Return what this says of the form of responses in units of `ratio`; a velocity has a zero at s = 0."""
        pins = tuple(pin for pin in (value.pin(ratio) for value in self.fixed) if pin is not None)
        sections = tuple(value.section for value in self.fixed if value.section)
        origin_zeros = DERIVATIVES.get(self.quantity, 0)
        return Known(self.order, self.zeros, self.integrators, origin_zeros, self.delay_s, sections, pins)


@cache
def _checks() -> dict[str, tuple[Any, TypeAdapter[Any]]]:
    return {name: (hint, TypeAdapter(hint)) for name, hint in get_type_hints(Asked, include_extras=True).items()}


def _allowed(annotation: Any) -> str:
    kind, info = get_args(annotation)
    choices = [choice for choice in get_args(kind) if isinstance(choice, str)]
    if choices:
        return ", ".join(choices)
    assert isinstance(info, FieldInfo)
    bounds = {
        name: getattr(bound, name) for bound in info.metadata for name in ("ge", "gt", "le") if hasattr(bound, name)
    }
    words = {"ge": "{} or more", "gt": "above {}", "le": "at most {}"}
    if "ge" in bounds and "le" in bounds:
        return f"{bounds['ge']} to {bounds['le']}"
    return ", ".join(words[name].format(f"{bound:g}") for name, bound in bounds.items()) or str(kind)
