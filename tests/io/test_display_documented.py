"""docs/display.md tells every key of a display file as the dataclasses have it, and no other."""

from tactuator.model.description import TABLES, keys_of
from tactuator.parameters import allowed, default
from tools.display_reference import PAGE, TABLE, reference


def test_display_page__tables_of_keys__are_current() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert {place[2] for place in TABLE.finditer(text)} == set(TABLES)
    assert text == reference(text), "out of date: make docs"


def test_keys__each__says_what_it_is_and_what_is_allowed() -> None:
    for name in TABLES:
        for key, about in keys_of(name).items():
            assert about.description, f"{name}.{key}"
            assert allowed(about), f"{name}.{key}"
            assert default(about) != "", f"{name}.{key}"
