"""JSON5: what it has beyond JSON, and that JSON is read as JSON is."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.patterns.acf import parse_json5

ANY = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)  # fmt: skip


@given(ANY)
def test_json5__json__is_read_as_json_is(value) -> None:
    text = json.dumps(value, ensure_ascii=False)
    assert parse_json5(text) == json.loads(text)


def test_json5__what_json_does_not_have__is_read() -> None:
    """The example of json5.org, in its kinds: comments, names, quotes, numbers, commas at the end."""
    text = """// comment
    {unquoted: 'and you can "quote" me', single: 'it\\'s \\x41', lines: "no \\\nbreak", hex: 0xdecaf,
     lead: .8675309, trail: 8675309., plus: +1, null: null, $a_1: [true, -.5e2, 1.e3,], /* in * between */ "last": {},}
    """
    assert parse_json5(text) == {
        "unquoted": 'and you can "quote" me', "single": "it's A", "lines": "no break", "hex": 0xDECAF,
        "lead": 0.8675309, "trail": 8675309.0, "plus": 1, "null": None, "$a_1": [True, -50.0, 1000.0], "last": {},
    }  # fmt: skip


@pytest.mark.parametrize(
    "text",
    ["", "[,]", "{,}", "[1,,2]", "{a:1,,}", "{a b}", "1 2", "[1],", "foo", "{a:foo}", "/* open", "'a\nb'", "@", "01",
     "[" * 100_000, "{a:Infinity}", "{a:0x}", "+", '"' + "x" * (1 << 20)],
)  # fmt: skip
def test_json5__other_text__is_refused(text) -> None:
    with pytest.raises(BadInput):
        parse_json5(text)
