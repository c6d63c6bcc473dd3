"""Questions to the person at the terminal."""

from __future__ import annotations

import sys

from tactuator.errors import BadInput


def asked_number(question: str) -> float:
    """Return the number that a person types; BadInput for anything else."""
    sys.stderr.write(question)
    sys.stderr.flush()
    line = sys.stdin.readline()
    try:
        return float(line)
    except ValueError:
        raise BadInput(f"{line.strip()!r} was typed", "a number") from None
