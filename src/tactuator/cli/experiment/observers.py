"""Options of `experiment observe` that give simulated subjects truths of one's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tactuator.errors import BadInput
from tactuator.io.curve import read_relative_curve
from tactuator.perception.curve import RelativeCurve


def truths_of(given: Sequence[str]) -> dict[str, RelativeCurve]:
    """Read curves of SUBJECT=CSV; raises BadInput for what has another form, and for a curve that cannot be read."""
    return {code: read_relative_curve(Path(text)) for code, text in pairs("--truth", "SUBJECT=CSV", given)}


def lapses_of(given: Sequence[str]) -> dict[str, float]:
    """Read lapse rates of SUBJECT=RATE; raises BadInput for what has another form."""
    found = {}
    for code, text in pairs("--lapse", "SUBJECT=RATE", given):
        try:
            found[code] = float(text)
        except ValueError:
            raise BadInput(f"--lapse {code}={text}", "SUBJECT=RATE with a number") from None
    return found


def pairs(option: str, form: str, given: Sequence[str], empty: bool = False) -> list[tuple[str, str]]:
    """Return (name, value) of each text of the form NAME=VALUE, or, where `empty` is allowed, NAME=.

    Raises BadInput for another form, or a name twice.
    """
    found = []
    for text in given:
        code, equals, value = text.partition("=")
        if not (code and equals and (value or empty)):
            raise BadInput(f"{option} {text!r}", f"{form}")
        found.append((code, value))
    if len({code for code, _ in found}) != len(found):
        name = form.partition("=")[0].lower()
        raise BadInput(f"{option} twice for a {name}", f"each {name} once")
    return found
