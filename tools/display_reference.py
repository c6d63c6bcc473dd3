"""Write the keys in docs/display.md from the fields of the dataclasses (`make docs`); a test fails when they are out of
date."""

import re
from pathlib import Path

from tactuator.model.description import TABLES, keys_of
from tactuator.parameters import allowed, default

PAGE = Path(__file__).resolve().parent.parent / "docs" / "display.md"
TABLE = re.compile(r"(<!-- keys of (\w+) -->\n).*?(<!-- end -->)", flags=re.DOTALL)


SHORT = {
    "each a number, ": "each ",
    "each a number": "of numbers",
    "each a text": "of strings",
    "a text": "string",
    r"1 to 50 printable characters, none of them / or \, the first no dot or blank": "string",
    "a whole number": "whole",
    "above 0": "> 0",
    "0 or more": "≥ 0",
    "two frequencies, 0 < low < high": "low, high",
}


def reference(page):
    """Return the text of the page with the tables of today."""
    return TABLE.sub(lambda place: place[1] + table(place[2]) + place[3], page)


def table(name):
    """Return the keys of one table of the display file, a line each: key, what is allowed, default, meaning."""
    lines = []
    for key, about in keys_of(name).items():
        usual, may_be = default(about), allowed(about)
        may_be = may_be.removeprefix("a number, ")
        may_be = "" if may_be == "a number" else may_be
        for words, short in SHORT.items():
            may_be = may_be.replace(words, short)
        said = (may_be, {None: "required", "none": "optional"}.get(usual, f"default {usual}"))
        lines.append(f"- `{key}` ({'; '.join(part for part in said if part)}): {about.description}")
    return "\n".join(lines) + "\n"


def main():
    """Write the page, whole or not at all."""
    text = PAGE.read_text(encoding="utf-8")
    missing = set(TABLES) - {place[2] for place in TABLE.finditer(text)}
    assert not missing, f"docs/display.md has no place for the keys of {', '.join(sorted(missing))}"
    part = PAGE.with_suffix(".part")
    part.write_text(reference(text), encoding="utf-8")
    part.rename(PAGE)


if __name__ == "__main__":
    main()
