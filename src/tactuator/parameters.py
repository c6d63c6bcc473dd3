"""Parameters: each is one field of one frozen dataclass, with type, default, bounds, unit (in its name) and sentence.

    @table("[prefilter]")
    class PrefilterRequirements:
        poles: Annotated[Whole, Field(ge=2, le=16, description="number of poles")] = 4

Such a table is held to what its fields allow wherever it is made: from a file's keys, from JSON, or in Python. What it
refuses is a `BadInput` that names the table and the key. Files, forms and the pages of reference are made of the
fields (`parameters`, `allowed`, `default`): nothing of a parameter is written twice.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache, reduce, wraps
from numbers import Real
from operator import or_
from os import PathLike
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from annotated_types import GroupedMetadata
from numpy.typing import ArrayLike
from pydantic import AfterValidator, ConfigDict, Field, InstanceOf, PlainValidator, Strict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as validated
from pydantic.fields import FieldInfo

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput, likely

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])

HIGHEST_RATE_HZ = 1e6  # beyond it double precision has too few digits for what is slow
LONGEST_S = 86400.0  # a day
SMALLEST = 1e-100
"""Size below which a number that is read must be zero, and its inverse above which a coefficient must not be: powers
and products of others stay within a double's range. A coefficient is a product of up to 16 frequencies."""
LARGEST = 1e30
"""Size above which no other number must be."""


def _of_size(largest: float) -> AfterValidator:
    def check(value: float) -> float:
        if value != 0.0 and not SMALLEST <= abs(value) < largest:
            raise BadInput(f"{value:g}", f"0, or {SMALLEST:g} to {largest:g} in size")
        return value

    return AfterValidator(check)


def _from_to(low: float, high: float) -> AfterValidator:
    """Return the annotation of a number beyond whose bounds nothing can be computed, in whatever it is used."""

    def check(value: float) -> float:
        if not low <= value <= high:
            raise BadInput(f"{value:g}", f"a number, {_plain(low)} to {_plain(high)}")
        return value

    return AfterValidator(check)


Number = Annotated[float, Field(strict=True, allow_inf_nan=False), _of_size(LARGEST)]
Coefficient = Annotated[float, Field(strict=True, allow_inf_nan=False), _of_size(1.0 / SMALLEST)]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
Decibels = Annotated[Number, _from_to(-1000.0, 1000.0)]
PositiveDecibels = Annotated[Decibels, Field(gt=0.0)]
Hertz = Annotated[Positive, _from_to(1e-6, HIGHEST_RATE_HZ)]
Whole = Annotated[int, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Seconds = Annotated[Number, Field(ge=0.0, le=LONGEST_S)]
Share = Annotated[Number, Field(ge=0.0, le=1.0)]


@dataclasses.dataclass(frozen=True)
class Wording:
    """What a page says of a parameter beyond its type and default: what is allowed, what is usual; and what a call in
    Python may pass, where a file has another form.
    """

    allowed: str = ""
    default: str = ""
    in_python: str = ""


Name = Annotated[
    str,
    Field(strict=True, pattern=r"^[^./\\\s\p{Cc}][^/\\\p{Cc}]{0,49}$"),
    Wording(r"1 to 50 printable characters, none of them / or \, the first no dot or blank"),
]
"""A name that becomes a part of a file's name, whose 255 bytes have room for 50 characters of four bytes."""


def _ascending(band: tuple[float, float]) -> tuple[float, float]:
    low, high = band
    if not low < high:
        raise BadInput(f"[{low:g}, {high:g}]", "0 < low < high")
    return band


Band = Annotated[tuple[Hertz, Hertz], AfterValidator(_ascending), Wording("two frequencies, 0 < low < high")]
"""Two frequencies in hertz, the lower first."""


def kept_by(check: Callable[[Any], Any], allowed: str) -> tuple[PlainValidator, Wording]:
    """Return the annotations of a parameter with a special type: `check` returns its value, or raises BadInput."""
    return PlainValidator(check), Wording(allowed)


def _array(value: Any) -> FloatArray:
    if not isinstance(value, np.ndarray):
        try:
            _NESTED.validate_python(value)
        except ValidationError:
            raise BadInput("not made of numbers", "a list of numbers, or a list of such lists") from None
    array = np.asarray(value, dtype=np.float64)
    size = np.abs(array[np.isfinite(array) & (array != 0.0)])
    beyond = size[(size < SMALLEST) | (size >= 1.0 / SMALLEST)]
    if beyond.size:
        raise BadInput(f"{beyond[0]:g} in size", f"numbers of {SMALLEST:g} to {1.0 / SMALLEST:g}")
    return array


_Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_NESTED: TypeAdapter[Any] = TypeAdapter(list[_Finite] | list[list[_Finite]], config=ConfigDict(defer_build=True))
Numbers = Annotated[FloatArray, *kept_by(_array, "a list of numbers, or a list of such lists")]
"""An array of numbers, or the lists that a file writes for one."""


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
def table(title: str, *, eq: bool = True) -> Callable[[type[T]], type[T]]:
    """Return a decorator for a frozen dataclass whose fields are checked whenever one is made.

    title: how a refusal names it, as a file writes the table; "": its keys are parameters of a call. Raises BadInput
    with that title and the key.
    """

    def decorate(cls: type[T]) -> type[T]:
        config = ConfigDict(arbitrary_types_allowed=True, extra="forbid")
        table_of: Any = validated(cls, frozen=True, eq=eq, config=config)
        check = table_of.__init__

        @wraps(check)
        def init(self: Any, /, *values: Any, **named: Any) -> None:
            try:
                check(self, *values, **named)
            except ValidationError as error:
                raise _refusal(table_of, title, error, in_python=True) from None

        table_of.__init__ = init
        hints, signature = get_type_hints(cls), inspect.signature(table_of)
        plain = [each.replace(annotation=hints.get(name, Any)) for name, each in signature.parameters.items()]
        table_of.__signature__ = signature.replace(parameters=plain)
        return cast(type[T], table_of)

    return decorate


def from_table(cls: type[T], values: Mapping[str, Any], *where: str) -> T:
    """Return the dataclass of a table's keys. Raises BadInput within `where`, the table as the file writes it."""
    require_known(values, cls.__pydantic_fields__, *where)  # type: ignore[attr-defined]
    made = object.__new__(cls)
    try:
        inspect.unwrap(cls.__init__)(made, **values)
    except ValidationError as error:
        refusal = _refusal(cls, "", error, in_python=False)
        refusal.where = (*where, *refusal.where)
        raise refusal from None
    return made


def require_known(values: Mapping[str, Any], keys: Mapping[str, Any], *where: str) -> None:
    """Raise BadInput for a key of a table that is none of `keys`."""
    for key in values:
        if key not in keys:
            raise _unknown_key(key, keys, where)


def _unknown_key(key: str, keys: Mapping[str, Any], where: tuple[str, ...]) -> BadInput:
    meant = likely(key.rpartition(".")[2], keys)
    return BadInput(f"not a known key{meant}", "" if meant else f"one of {', '.join(keys)}", where=where, key=key)


@cache
def parameters(cls: type) -> dict[str, FieldInfo]:
    """Return the fields of a table that are keys of its file, by name: those with a sentence."""
    known: dict[str, FieldInfo] = cls.__pydantic_fields__  # type: ignore[attr-defined]
    return {name: about for name, about in known.items() if about.description}


def default(about: FieldInfo) -> str | None:
    """Return the default of a parameter as a file writes it, "none" where nothing is asked; None where it must be
    said."""
    words = _mark(about, Wording)
    if words is not None and words.default:
        return str(words.default)
    if about.is_required():
        return None
    return "none" if about.default is None else literal(about.default)


def literal(value: Any) -> str:
    """Return a value as TOML writes it."""
    return json.dumps(value, ensure_ascii=False)


_UNITS = {
    "hz": "Hz", "v": "V", "mm": "mm", "s": "s", "kg": "kg", "db": "dB", "db_sl": "dB SL", "deg": "degrees",
    "bits": "bits", "samples": "samples", "v_peak": "V, peak", "v_rms": "V, rms", "v_per_mm": "V/mm", "v_per_n": "V/N",
    "mm2": "mm²", "n": "N", "years": "years",
}  # fmt: skip


def unit(name: str) -> str:
    """Return the unit that a parameter's name ends in, or "" for a number without one."""
    endings = [ending for ending in _UNITS if f"_{name}".endswith(f"_{ending}")]
    return _UNITS[max(endings, key=len)] if endings else ""


def allowed(about: FieldInfo) -> str:
    """Return in words what a parameter may be."""
    return _allowed(about.annotation, list(about.metadata))


def choices(about: FieldInfo) -> list[str] | None:
    """Return the values of which a parameter is one, as a file writes them; None where it is not one of a few."""
    kind = about.annotation
    return [literal(value) for value in get_args(kind)] if get_origin(kind) is Literal else None


def _mark(about: FieldInfo, kind: type[Any]) -> Any:
    return next((mark for mark in reversed(about.metadata) if isinstance(mark, kind)), None)


def _allowed(kind: Any, marks: list[Any], in_python: bool = False) -> str:
    words = [mark for mark in reversed(marks) if isinstance(mark, Wording)]
    said = [*(mark.in_python for mark in words if in_python), *(mark.allowed for mark in words)]
    if any(said):
        return next(filter(None, said))
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        nested = [more for mark in inner[1:] for more in (mark.metadata if isinstance(mark, FieldInfo) else [mark])]
        return _allowed(inner[0], [*nested, *marks], in_python)
    if origin is Literal:
        return ", ".join(literal(value) for value in inner)
    if origin in (Union, UnionType):
        return " or ".join(_allowed(member, marks, in_python) for member in inner if member is not NoneType)
    if origin in (tuple, list):
        return _EACH + _allowed(inner[0], [], in_python)
    name = _NAMES.get(kind, _one(kind) if in_python else "a table")
    return f"{name}{_bounds(marks)}"


def _one(kind: type) -> str:
    return f"{'an' if kind.__name__[0] in 'aeiouAEIO' else 'a'} {kind.__name__}"


_NAMES = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}


def _bounds(marks: list[Any]) -> str:
    limits = {"ge": "", "gt": "", "le": "", "lt": ""}
    for mark in marks:
        limits |= {name: _plain(getattr(mark, name)) for name in limits if hasattr(mark, name)}
    if limits["ge"] and limits["le"]:
        return f", {limits['ge']} to {limits['le']}"
    words = {
        "gt": f"above {limits['gt']}", "ge": f"{limits['ge']} or more", "le": f"up to {limits['le']}",
        "lt": f"below {limits['lt']}",
    }  # fmt: skip
    return "".join(f", {words[name]}" for name in words if limits[name])


def _plain(value: float) -> str:
    return str(int(value)) if value == int(value) else f"{value:g}"


_EACH = "a list, each "
_UNKNOWN = ("unexpected_keyword_argument", "extra_forbidden")


def _refusal(cls: type, title: str, error: ValidationError, in_python: bool) -> BadInput:
    faults = error.errors(include_url=False)
    fault = next((each for each in faults if each["type"] in _UNKNOWN), faults[0])
    fields: dict[str, FieldInfo] = cls.__pydantic_fields__  # type: ignore[attr-defined]
    places = list(fault["loc"])
    if places and isinstance(places[0], int):
        places[0] = list(fields)[places[0]]
    path = [str(place) for place in places]
    key, place = ".".join(path), (title,) if title else ()
    reason = fault.get("ctx", {}).get("error")
    if isinstance(reason, BadInput) and (reason.key or reason.where or not path):
        return BadInput(reason.got, reason.allowed, where=(*place, *path, *reason.where), key=reason.key)
    if isinstance(reason, BadInput):
        about = _owner(cls, path).get(path[-1])
        marks = [] if about is None else list(about.metadata)
        if in_python and about and reason.allowed in [mark.allowed for mark in marks if isinstance(mark, Wording)]:
            reason.allowed = _allowed(about.annotation, marks, in_python)
        return BadInput(reason.got, reason.allowed, where=place, key=key)
    fields = _owner(cls, path)
    if fault["type"] in _UNKNOWN:
        return _unknown_key(key, fields, place)
    fields = {**_owner(cls, path[:-1]), **fields}  # an entry of a list of tables is refused by what the list may be
    about = next((fields[place] for place in reversed(path) if place in fields), None)
    words = "" if about is None else _allowed(about.annotation, list(about.metadata), in_python)
    if places and isinstance(places[-1], int):
        words = words.removeprefix(_EACH)
    if fault["type"] == "missing":
        return BadInput("missing", words, where=place, key=key)
    value = fault["input"]
    got = f"{value:g}" if isinstance(value, float) else repr(value)
    if not isinstance(value, str | Real | list | tuple | dict | None):
        got = _one(type(value))
    return BadInput(got if len(got) < 100 else f"{got[:96]} ...", words, where=place, key=key)


def _owner(cls: Any, path: list[str]) -> dict[str, FieldInfo]:
    """Return the fields of the table, `cls` or one within it, that has the last key of the path."""
    fields: dict[str, FieldInfo] = cls.__pydantic_fields__
    for place in path[:-1]:
        inner = _table_within(fields[place].annotation) if place in fields else None
        fields = fields if inner is None else inner.__pydantic_fields__
    return fields


def _table_within(kind: Any) -> Any:
    if hasattr(kind, "__pydantic_fields__"):
        return kind
    return next((table for each in get_args(kind) if (table := _table_within(each)) is not None), None)


def checked(function: F) -> F:
    """Return a function that refuses, by BadInput, an argument of another type than its annotation, or beyond the
    bounds there. Its signature has the types without marks, as `help` shows them.
    """
    signature, title = inspect.signature(function), function.__qualname__.removesuffix(".__init__")

    @cache
    def arguments() -> dict[str, tuple[TypeAdapter[Any], str, str]]:
        hints = get_type_hints(function, include_extras=True)
        known = {name: _unmarked(hints[name]) for name in signature.parameters if name in hints}
        return {
            name: (
                TypeAdapter(_argument(kind, limits)),
                _allowed(_argument(kind), [limit for limit in limits if isinstance(limit, Wording)]),
                _bounds(limits).removeprefix(", "),
            )
            for name, (kind, limits) in known.items()
        }

    @wraps(function)
    def guarded(*values: Any, **named: Any) -> Any:
        try:
            given = signature.bind(*values, **named).arguments
        except TypeError as error:
            strange = next((name for name in named if name not in signature.parameters), "")
            raise TypeError(f"{title}: {error}{likely(strange, signature.parameters)}") from None
        for name, (adapter, kind, ends) in arguments().items():
            value = given.get(name)
            try:
                if name in given:
                    adapter.validate_python(value.item() if isinstance(value, np.generic) else value)
            except ValidationError as error:
                got = repr(value)[:80] if isinstance(value, str | Real | None) else _one(type(value))
                faults = error.errors()
                is_beyond = not {"greater_than_equal", "less_than_equal"}.isdisjoint(e["type"] for e in faults)
                reasons = [
                    reason.allowed for e in faults if isinstance(reason := e.get("ctx", {}).get("error"), BadInput)
                ]
                raise BadInput(got, (is_beyond and ends) or (*reasons, kind)[0], where=(title,), key=name) from None
        return function(*values, **named)

    parameters = [each.replace(annotation=_unmarked(each.annotation)[0]) for each in signature.parameters.values()]
    vars(guarded)["__signature__"] = signature.replace(parameters=parameters)
    return cast(F, guarded)


def _unmarked(hint: Any) -> tuple[Any, list[Any]]:
    """Return an annotation's type, and its bounds and wordings."""
    if get_origin(hint) is not Annotated:
        return hint, []
    kind, *marks = get_args(hint)
    bounds = [bound for mark in marks if isinstance(mark, GroupedMetadata) for bound in mark]
    return kind, [*bounds, *(mark for mark in marks if isinstance(mark, Wording))]


_LEAVES: dict[Any, Any] = {
    float: Number, int: Whole, str: Annotated[str, Strict()], bool: Annotated[Flag, Wording("True or False")],
    NoneType: Annotated[None, Wording("None")], Any: Any,
}  # fmt: skip


def _argument(hint: Any, limits: Sequence[Any] = ()) -> Any:
    """Return a type as pydantic holds an argument to it: nothing is converted, and of a class only instances go."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint == ArrayLike:
        return Any
    if origin in (Union, UnionType):
        names_a_path = any(get_origin(member) is PathLike for member in inner)
        members = [member for member in inner if not (names_a_path and member is str)]
        return reduce(or_, (_argument(member, limits) for member in members))
    if origin is PathLike:
        return Annotated[_argument(str) | InstanceOf[PathLike[str]], Wording("the path of a file")]
    if origin in (list, Sequence):
        each = _argument(inner[0])
        kinds = Annotated[list[each], Strict()] | Annotated[tuple[each, ...], Strict()]  # type: ignore[valid-type]
        return Annotated[kinds, Wording(f"a list, each {_allowed(each, [])}")]
    if hint in _LEAVES:
        return reduce(lambda kind, limit: Annotated[kind, limit], limits if hint in (int, float) else (), _LEAVES[hint])
    if origin is tuple:
        length = Field(min_length=len(inner), max_length=len(inner))
        return Annotated[tuple, InstanceOf(), length, Wording(f"a tuple of {len(inner)}")]  # type: ignore[type-arg]
    kind = origin or hint
    return Annotated[kind, InstanceOf(), Wording(getattr(kind, "in_words", _one(kind)))]  # type: ignore[type-arg]
