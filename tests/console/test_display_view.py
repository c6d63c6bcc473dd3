"""The view Display: refusals at their line, values changed in place, the same display as the file's."""

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactuator.console.display_view import DisplayJudge, DisplayRead, DisplaySet, line_of, with_literal
from tactuator.console.state import ConsoleState
from tactuator.errors import BadInput
from tactuator.io.shipped import EXAMPLES, example_names
from tests.console.pages import console_page, go, saved_by, tab_to

EXAMPLE = (EXAMPLES / "display.toml").read_text("utf-8")
DISPLAYS = [name for name in example_names() if name.startswith("displays/") or name == "display.toml"]


def judged(text, state=None):
    return DisplayJudge(text=text, display="example:display.toml").answer(state or ConsoleState())


def test_judge__of_a_faulty_text__names_the_line():
    for old, new in (
        ("bits = 16", "bits = 99"),
        ("bits = 16", 'bits = "many"'),
        ("phase_margin_deg = 50.0", "phase_margin_deg = -50.0"),
        ("sensor_gain_v_per_mm = 0.1967", "sensor_gain_v_per_mm = true"),
        ('curve = "bolanowski-1988"', 'curve = "nobody-2099"'),
        ("poles = 4", "polse = 4"),
        ("poles = 4", "poles = = 4"),
        ("[prefilter]", "[perfilter]"),
    ):
        text = EXAMPLE.replace(old, new, 1)
        judgement = judged(text)
        assert judgement["fault"]
        assert judgement["line"] == [n for n, line in enumerate(text.splitlines(), 1) if new in line][-1], new


def test_judge__of_every_example__has_its_display_and_form():
    state = ConsoleState()
    for name in DISPLAYS:
        text = DisplayRead(display=f"example:{name}").answer(state)["text"]
        found = DisplayJudge(text=text, display=f"example:{name}").answer(state)
        assert (found["fault"], found["doubts"]) == (None, []), name
        assert state.display(found["key"]) == state.display(f"example:{name}")
        channels = tomllib.loads(text)["channel"]
        assert [one["name"] for one in found["sketch"]["channels"]] == [one["name"] for one in channels]
        assert [one["place"] for one in found["form"] if one["table"] == "channel"] == list(range(len(channels)))


def test_judge__of_a_travel_in_metres__is_doubted_and_says_so_of_each_channel():
    found = judged(EXAMPLE.replace("travel_mm = 12.5", "travel_mm = 0.0125"))
    assert found["fault"] is None
    assert {one.partition(":")[0] for one in found["doubts"]} == {"index", "thumb", "middle"}
    assert any("travel_mm in metres" in one for one in found["doubts"])


def test_set__of_a_value__changes_that_line_alone_and_keeps_its_comment():
    asked = DisplaySet(text=EXAMPLE, table="channel", place=1, key="travel_mm", value="9.5")
    text = asked.answer(ConsoleState())["text"]
    changed = [(a, b) for a, b in zip(EXAMPLE.splitlines(), text.splitlines(), strict=True) if a != b]
    assert changed == [("travel_mm = 12.5", "travel_mm = 9.5")]
    assert tomllib.loads(text)["channel"][1]["travel_mm"] == 9.5
    text = with_literal(EXAMPLE, "converter", 0, "range_v", "5.0")
    assert "range_v = 5.0               # +/- 10 V" in text


@given(number=st.floats(allow_nan=False, allow_infinity=False), which=st.integers(0, 2))
@settings(max_examples=40)
def test_set__of_any_number__is_read_back_and_nothing_else_changes(number, which):
    text = with_literal(EXAMPLE, "channel", which, "model_error_db", repr(number))
    tables = tomllib.loads(text)
    assert tables["channel"][which].pop("model_error_db") == number
    assert tables == tomllib.loads(EXAMPLE)


def test_set__of_what_is_no_value__is_refused_and_in_a_table_that_is_not_there_adds_it():
    for value in ("", "= 3", "[1,", '"', "1 2", "3\n[x]"):
        with pytest.raises(BadInput, match="allowed"):
            with_literal(EXAMPLE, "prefilter", 0, "poles", value)
    text = with_literal(EXAMPLE, "objectives", 0, "flatness_db", "0.5")
    assert tomllib.loads(text)["objectives"] == {"flatness_db": 0.5}


@given(st.text(max_size=300), st.text(max_size=80), st.text(max_size=20))
@settings(max_examples=60)
def test_line__of_any_text_and_error__is_a_line_or_none(text, where, key):
    found = line_of(text, BadInput("wrong", where=(where,), key=key))
    assert found is None or found >= 1


@pytest.mark.slow
def test_display__by_keyboard_alone__is_changed_in_the_form_refused_at_its_line_and_saved(browser, tmp_path):
    with console_page(browser) as page:
        go(page, "display", display="example:display.toml")
        page.wait_for_selector("#use")
        tab_to(page, "[data-field='[display] rate_hz']")
        page.keyboard.press("Control+a")
        page.keyboard.type("-5")
        page.keyboard.press("Enter")
        page.keyboard.press("Tab")
        page.wait_for_selector("#fault:has-text('Line 4')")
        assert "rate_hz = -5" in page.locator("#text").input_value()
        page.locator("button:has-text('Undo')").focus()
        page.keyboard.press("Enter")
        page.wait_for_selector("#fault:empty", state="attached")
        (tmp_path / "bad.toml").write_bytes(b"\xff\xfe\x00")
        page.locator("input[type=file]").set_input_files(tmp_path / "bad.toml")
        page.wait_for_selector(".drop .told:has-text('not text')")  # what was there before stays
        assert saved_by(page, "a.save", tmp_path / "display.toml").read_text("utf-8") == EXAMPLE
