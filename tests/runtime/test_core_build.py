"""What Python is told of core's headers."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def build() -> ModuleType:
    spec = importlib.util.spec_from_file_location("_core_build", ROOT / "src/tactuator/runtime/_core_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_declarations__inline_function__loses_its_body(build: ModuleType) -> None:
    types = "#define A 1\n/* int no; */\ntypedef struct {\n    int x;\n} t;\n"
    told = build.declarations(types + "inline int f(const t *a)\n{\n    return a->x;\n}\n")
    assert " ".join(told.split()) == "typedef struct { int x; } t; int f(const t *a) ;"


def test_declarations__other_body__is_refused(build: ModuleType) -> None:
    with pytest.raises(ValueError, match="only inline functions may have a body"):
        build.declarations("int f(void)\n{\n    return 1;\n}\nint g(void);\n")


def test_declarations__unfinished__is_refused(build: ModuleType) -> None:
    with pytest.raises(ValueError, match="does not end"):
        build.declarations("typedef struct { int x;")


def test_in_order__every_header__comes_after_what_it_includes(build: ModuleType) -> None:
    ordered = build.in_order(["display/closed_loop.h", "arithmetic/finite.h"])
    assert (
        ordered.index("arithmetic/finite.h")
        < ordered.index("arithmetic/section.h")
        < ordered.index("control/controller.h")
    )
    assert ordered.index("control/controller.h") < ordered.index("display/closed_loop.h")


def test_flags__keep_the_bits(build: ModuleType) -> None:
    assert {"-std=c99", "-ffp-contract=off"} <= set(build.FLAGS)
    assert not any(flag.startswith(("-march", "-ffast")) for flag in build.FLAGS)
