"""Things that a user knows or wishes of the model that is identified: each with its default, bounds and sentence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_type_hints

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from tactuator.errors import BadInput, unknown
from tactuator.identification.form import MOST_POLES, Form, Known
from tactuator.model.plant import DERIVATIVES
from tactuator.model.plant_model import PlantModel

NAMES = ("gain", "pole", "delay_s")


@contextmanager
def solvable() -> Iterator[None]:
    """Refuse what leaves a step of linear algebra without an answer, whichever step it is."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise BadInput(f"no model can be estimated from it ({error})", "a position that the command moves") from None


@dataclass(frozen=True)
class Fixed:
    """A value that is known: gain (position over command at zero frequency), pole (Hz; first-order low-pass), delay_s
    (dead time).
    """

    name: str
    value: float

    def __post_init__(self) -> None:
        if self.name not in NAMES:
            raise unknown("value to fix", self.name, NAMES)
        if not math.isfinite(self.value):
            raise BadInput(f"fixed {self}", "a finite number")
        if self.name == "gain" and self.value == 0.0:
            raise BadInput(f"fixed {self}", "other than zero")
        if self.name == "pole" and self.value <= 0.0:
            raise BadInput(f"fixed {self}", "above zero (the pole lies in the left half plane)")
        if self.name == "delay_s" and self.value < 0.0:
            raise BadInput(f"fixed {self}", "0 or more")

    def __str__(self) -> str:
        return f"{self.name}={self.value:g}"

    @classmethod
    def parse(cls, text: str) -> Fixed:
        """Return the value of a text NAME=VALUE. Raises BadInput."""
        name, _, number = text.partition("=")
        try:
            value = float(number)
        except ValueError:
            raise BadInput(f"fixed {text!r}", f"NAME=VALUE, names: {', '.join(NAMES)}") from None
        return cls(name.strip(), value)

    @property
    def rate(self) -> float:
        """Return the rate of a known pole, 1/s."""
        return 2.0 * math.pi * self.value

    def binds(self, form: Form) -> bool:
        """Return whether a fit of that form has the value: one to compare with it has neither gain nor poles fixed."""
        return {"gain": form.gain is not None, "pole": bool(form.known), "delay_s": not form.dead_time}[self.name]

    def of_model(self, model: PlantModel) -> tuple[float, float] | None:
        """Return the same value of another model and its 95 % half-width (nan: not known), None where that has none."""
        if self.name == "gain":
            if model.den[-1] == 0.0 or model.num[-1] == 0.0:
                return None
            return float(model.num[-1] / model.den[-1]), model.confidence()["gain"]
        size = np.abs(np.roots(model.den)) / (2.0 * np.pi)
        return float(size[np.argmin(np.abs(np.log(np.maximum(size, 1e-300) / self.value)))]), float("nan")


@dataclass(frozen=True)
class IdentifyOptions:
    """Things known or wished beforehand. Raises BadInput for what is out of bounds or contradicts itself."""

    order: Annotated[int | None, Field(ge=1, le=MOST_POLES, description="Number of poles (default: chosen).")] = None
    zeros: Annotated[int | None, Field(ge=0, le=MOST_POLES, description="Number of zeros (default: chosen).")] = None
    integrators: Annotated[int, Field(ge=0, le=MOST_POLES, description="Poles known to lie at s = 0.")] = 0
    hold: Annotated[
        Literal["auto", "zero-order", "first-order", "band-limited"],
        Field(
            description="The command between its samples: zero-order, first-order (held by a converter), band-limited "
            "(recorded through an anti-aliasing filter), or auto."
        ),
    ] = "auto"
    quantity: Annotated[
        Literal["auto", "displacement", "velocity", "acceleration"],
        Field(description="What the position is: displacement, velocity, acceleration, or auto."),
    ] = "auto"
    friction: Annotated[bool, Field(description="Estimate friction.")] = True
    fixed: Annotated[
        tuple[Fixed, ...],
        Field(
            description="Known value, NAME=VALUE: gain (position over command at 0 Hz), "
            "pole (Hz; first-order low-pass), delay_s (dead time)."
        ),
    ] = ()
    closed_loop: Annotated[
        Literal["auto", "yes", "no"],
        Field(description="Whether a position loop was closed: yes, no, or auto."),
    ] = "auto"
    method: Annotated[
        Literal["refined", "rls"],
        Field(description="Method: refined (maximum likelihood), rls (the paper's recursive least squares)."),
    ] = "refined"
    forgetting: Annotated[float, Field(gt=0.0, le=1.0, description="Forgetting factor; 1 keeps everything.")] = 1.0

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
        self._require_consistent(origin_zeros)
        if self.method != "refined" and self.fixed:
            raise BadInput(f"fixed values with the method {self.method!r}", "with 'refined' alone")

    def _require_consistent(self, origin_zeros: int) -> None:
        """Refuse values that contradict each other or the form."""
        names = [value.name for value in self.fixed]
        poles = self.integrators + names.count("pole")
        for name in ("gain", "delay_s"):
            if names.count(name) > 1:
                raise BadInput(f"{name} is fixed twice", "once")
        if poles > (self.order or MOST_POLES):
            raise BadInput(f"{poles} poles are known of {self.order or MOST_POLES}", "no more than there are")
        if "gain" in names and (self.integrators or origin_zeros):
            raise BadInput("a gain at zero frequency beside poles or zeros at s = 0", "one of them")

    @property
    def delay_s(self) -> float | None:
        """Return the dead time, where it is known."""
        return next((value.value for value in self.fixed if value.name == "delay_s"), None)

    @property
    def gain_and_poles(self) -> tuple[Fixed, ...]:
        """Return the fixed values that are held against the record's own."""
        return tuple(value for value in self.fixed if value.name != "delay_s")

    def of(self, about: Mapping[str, str]) -> IdentifyOptions:
        """Return the same for a record with that description: its quantity, if none was requested."""
        if self.quantity != "auto":
            return self
        stated = about.get("quantity", "")
        return replace(self, quantity=stated if stated in DERIVATIVES else "displacement")  # type: ignore[arg-type]

    def known(self, ratio: float) -> Known:
        """Return what this says of the form of responses in units of `ratio`; a velocity has a zero at s = 0."""
        gain = next((value.value / ratio for value in self.fixed if value.name == "gain"), None)
        rates = tuple(value.rate for value in self.fixed if value.name == "pole")
        origin_zeros = DERIVATIVES.get(self.quantity, 0)
        return Known(self.order, self.zeros, self.integrators, origin_zeros, self.delay_s, rates, gain)


@cache
def _checks() -> dict[str, tuple[Any, TypeAdapter[Any]]]:
    return {
        name: (hint, TypeAdapter(hint)) for name, hint in get_type_hints(IdentifyOptions, include_extras=True).items()
    }


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
