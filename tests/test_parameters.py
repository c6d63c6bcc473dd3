"""Parameters as fields: held to their bounds wherever a table is made, and told by the fields alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from pydantic import Field

from tactuator.errors import BadInput
from tactuator.parameters import (
    Band,
    Flag,
    InFile,
    Number,
    Numbers,
    Positive,
    Whole,
    Wording,
    allowed,
    choices,
    default,
    from_table,
    in_file,
    parameters,
    plain,
    table,
    unit,
)


@table("[inner]")
class Inner:
    gain: Positive = 1.0

    def __post_init__(self) -> None:
        if self.gain == 13.0:
            raise BadInput("13", "another", key="gain")


@table("[outer]", eq=False)
class Outer:
    name: Annotated[str, InFile("x"), Field(description="how it is called")]
    bits: Annotated[Whole, Field(ge=8, le=24, description="of the converter")] = 16
    limit_db: Annotated[Number | None, Field(description="at most")] = None
    band_hz: Annotated[Band, Field(description="where")] = (1.0, 2.0)
    on: Annotated[Flag, Field(description="whether")] = False
    kind: Annotated[Literal["a", "b"], Wording(default="by itself"), Field(description="which")] = "a"
    lines_hz: Annotated[tuple[Positive, ...], Field(description="hum")] = ()
    points: Numbers = Field(default_factory=lambda: np.zeros(1))
    inner: Inner = Inner()


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"bits": 7}, "[outer]: bits is 7; allowed: a whole number, 8 to 24"),
        ({"bits": True}, "[outer]: bits is True; allowed: a whole number, 8 to 24"),
        ({"bits": "9"}, "[outer]: bits is '9'; allowed: a whole number, 8 to 24"),
        ({"limit_db": float("nan")}, "[outer]: limit_db is nan; allowed: a number"),
        ({"limit_db": True}, "[outer]: limit_db is True; allowed: a number"),
        ({"band_hz": [2.0, 1.0]}, "[outer]: band_hz is [2, 1]; allowed: 0 < low < high"),
        ({"band_hz": [0.0, 1.0]}, "[outer]: band_hz.0 is 0; allowed: two frequencies, 0 < low < high"),
        ({"on": 1}, "[outer]: on is 1; allowed: true or false"),
        ({"kind": "c"}, """[outer]: kind is 'c'; allowed: "a", "b\""""),
        ({"lines_hz": [1.0, -1.0]}, "[outer]: lines_hz.1 is -1; allowed: a list, each a number, above 0"),
        (
            {"points": [1.0, "x"]},
            "[outer]: points is not made of numbers; allowed: a list of numbers, or a list of such",
        ),
        ({"inner": {"gain": 13.0}}, "[outer]: inner: gain is 13; allowed: another"),
        ({"colour": 1}, "[outer]: colour is not a key that is known; allowed: name, bits"),
        ({"name": 3}, "[outer]: name is 3; allowed: a text"),
    ],
)
def test_table__made_in_python_or_of_a_file__is_refused_alike(keys: dict[str, Any], told: str) -> None:
    with pytest.raises(BadInput) as refused:
        Outer(**{"name": "x", **keys})
    assert str(refused.value).startswith(told)
    with pytest.raises(BadInput) as refused:
        from_table(Outer, {"name": "x", **keys}, "file", "[[outer]] 'x'")
    assert str(refused.value).startswith(told.replace("[outer]", "file: [[outer]] 'x'"))
    assert refused.value.where[:2] == ("file", "[[outer]] 'x'")


def test_table__key_missing_or_changed__is_refused() -> None:
    with pytest.raises(BadInput, match="name is missing; allowed: a text") as refused:
        from_table(Outer, {}, "[outer]")
    assert (refused.value.where, refused.value.key) == (("[outer]",), "name")
    with pytest.raises(BadInput, match="bits is 99"):
        replace(Outer("x"), bits=99)


def test_table__numbers_as_a_file_or_numpy_has_them__are_floats_and_tuples() -> None:
    outer = Outer("x", limit_db=3, lines_hz=[np.float64(50.0), 100], points=[[1, 2], [3, 4]])  # type: ignore[arg-type]
    assert (outer.limit_db, outer.lines_hz) == (3.0, (50.0, 100.0))
    assert outer.points.shape == (2, 2)
    assert plain(outer)["points"] == [[1.0, 2.0], [3.0, 4.0]]
    assert plain(outer)["inner"] == {"gain": 1.0}


def test_parameters__of_a_table__tell_default_choices_unit_and_what_is_allowed() -> None:
    about = parameters(Outer)
    assert list(about) == ["name", "bits", "limit_db", "band_hz", "on", "kind", "lines_hz"]
    assert [default(each) for each in about.values()] == ['"x"', "16", "none", "[1.0, 2.0]", "false", "by itself", "[]"]
    assert choices(about["kind"]) == ['"a"', '"b"']
    assert choices(about["bits"]) is None
    assert in_file(Outer) == {"name": "x"}
    assert allowed(about["limit_db"]) == "a number"
    assert [unit(name) for name in ("rate_hz", "level_db_sl", "gain_v_per_mm", "poles")] == ["Hz", "dB SL", "V/mm", ""]
