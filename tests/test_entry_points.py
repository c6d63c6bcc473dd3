"""Entry points of other packages, found by name or refused; and parameters as fields, held to their bounds."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from pydantic import Field

from tactuator import parameters as p
from tactuator.entry_points import plugin, plugins
from tactuator.errors import BadInput
from tactuator.plain import plain

GROUP = "tactuator.procedures"


def test_plugin__another_package_declares_it__what_it_refers_to(install):
    install(GROUP, "staircase", "class Keys:\n    pass\n", "Keys")
    assert "staircase" in plugins(GROUP)
    assert plugin(GROUP, "staircase").__name__ == "Keys"


def test_plugin__nobody_declares_it__names_of_all_there_are():
    with pytest.raises(BadInput, match=r"no plug-in 'stairs'(; expected| .did you mean)") as refused:
        plugin(GROUP, "stairs")
    assert refused.value.where == (GROUP,)
    with pytest.raises(BadInput, match=r"none: no package declares no.such.group"):
        plugin("no.such.group", "stairs")


@pytest.mark.parametrize(("source", "reason"), [("import no_such_module", "ModuleNotFoundError"), ("1 / 0", "ZeroDiv")])
def test_plugin__cannot_be_loaded__package_and_reason_are_named(install, source, reason):
    install(GROUP, "staircase", f"{source}\n", "Keys")
    with pytest.raises(BadInput, match=f"'staircase' of foreign_laboratory 1.0 .* cannot be loaded: {reason}"):
        plugin(GROUP, "staircase")


def test_plugins__two_packages_give_one_name_different_things__both_are_named(install):
    install(GROUP, "staircase", "class Keys:\n    pass\n", "Keys")
    install(GROUP, "staircase", "class Others:\n    pass\n", "Others", package="second_laboratory")
    with pytest.raises(BadInput, match=r"declared by foreign_laboratory.* and second_laboratory"):
        plugins(GROUP)


@p.table("[inner]")
class Inner:
    gain: p.Positive = 1.0

    def __post_init__(self) -> None:
        if self.gain == 13.0:
            raise BadInput("13", "another", key="gain")


@p.table("[outer]", eq=False)
class Outer:
    name: Annotated[str, Field(description="how it is called")]
    bits: Annotated[p.Whole, Field(ge=8, le=24, description="of the converter")] = 16
    limit_db: Annotated[p.Number | None, Field(description="at most")] = None
    band_hz: Annotated[p.Band, Field(description="where")] = (1.0, 2.0)
    on: Annotated[p.Flag, Field(description="whether")] = False
    kind: Annotated[Literal["a", "b"], p.Wording(default="by itself"), Field(description="which")] = "a"
    lines_hz: Annotated[tuple[p.Positive, ...], Field(description="hum")] = ()
    points: p.Numbers = Field(default_factory=lambda: np.zeros(1))
    inner: Inner = Inner()


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"bits": 7}, "[outer]: bits is 7; it must be a whole number, 8 to 24"),
        ({"bits": True}, "[outer]: bits is True; it must be a whole number, 8 to 24"),
        ({"bits": "9"}, "[outer]: bits is '9'; it must be a whole number, 8 to 24"),
        ({"limit_db": float("nan")}, "[outer]: limit_db is nan; it must be a number"),
        ({"limit_db": True}, "[outer]: limit_db is True; it must be a number"),
        ({"band_hz": [2.0, 1.0]}, "[outer]: band_hz is [2, 1]; it must be 0 < low < high"),
        ({"band_hz": [0.0, 1.0]}, "[outer]: band_hz.0 is 0; it must be two frequencies, 0 < low < high"),
        ({"on": 1}, "[outer]: on is 1; it must be true or false"),
        ({"kind": "c"}, """[outer]: kind is 'c'; it must be "a", "b\""""),
        ({"lines_hz": [1.0, -1.0]}, "[outer]: lines_hz.1 is -1; it must be a number, above 0"),
        ({"points": [1.0, "x"]}, "[outer]: points is not made of numbers; it must be a list of numbers, or a list of"),
        ({"inner": {"gain": 13.0}}, "[outer]: inner: gain is 13; it must be another"),
        ({"colour": 1}, "[outer]: colour is not a known key; it must be one of name, bits"),
        ({"name": 3}, "[outer]: name is 3; it must be a text"),
    ],
)
def test_table__made_in_python_or_of_a_file__is_refused_alike(keys: dict[str, Any], told: str) -> None:
    with pytest.raises(BadInput) as refused:
        Outer(**{"name": "x", **keys})
    assert str(refused.value).startswith(told)
    with pytest.raises(BadInput) as refused:
        p.from_table(Outer, {"name": "x", **keys}, "file", "[[outer]] 'x'")
    assert str(refused.value).startswith(told.replace("[outer]", "file: [[outer]] 'x'"))
    assert refused.value.where[:2] == ("file", "[[outer]] 'x'")


def test_table__keys_missing_or_changed__are_refused_and_arrays_are_plain() -> None:
    with pytest.raises(BadInput, match="name is missing; it must be a text") as refused:
        p.from_table(Outer, {}, "[outer]")
    assert (refused.value.where, refused.value.key) == (("[outer]",), "name")
    with pytest.raises(BadInput, match="bits is 99"):
        replace(Outer("x"), bits=99)
    outer = Outer("x", limit_db=3, lines_hz=[np.float64(50.0), 100], points=[[1, 2], [3, 4]])  # type: ignore[arg-type]
    assert (outer.limit_db, outer.lines_hz) == (3.0, (50.0, 100.0))
    assert outer.points.shape == (2, 2)
    assert plain(outer)["points"] == [[1.0, 2.0], [3.0, 4.0]]
    assert plain(outer)["inner"] == {"gain": 1.0}


def test_parameters__of_a_table__tell_default_choices_unit_and_what_is_allowed() -> None:
    about = p.parameters(Outer)
    assert list(about) == ["name", "bits", "limit_db", "band_hz", "on", "kind", "lines_hz"]
    assert [p.default(each) for each in about.values()] == [
        None,
        "16",
        "none",
        "[1.0, 2.0]",
        "false",
        "by itself",
        "[]",
    ]
    assert p.choices(about["kind"]) == ['"a"', '"b"']
    assert p.choices(about["bits"]) is None
    assert p.allowed(about["limit_db"]) == "a number"
    assert [p.unit(name) for name in ("rate_hz", "level_db_sl", "gain_v_per_mm", "poles")] == [
        "Hz",
        "dB SL",
        "V/mm",
        "",
    ]
