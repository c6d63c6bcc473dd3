"""Sensors that lie, tried on the guard: whether it notices, how soon, how far the motor had gone.

`python -m tests.rig.guard.lying_sensor` writes the table of decision 0706 anew.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactuator.runtime.safety_table import Fault
from tests.rig.guard.guarded import Guarded, designed

SITUATIONS = {"silence": (0.0, 0.0), "2 Hz, 40 dB SL": (2.0, 100.0), "30 Hz, 40 dB SL": (30.0, 100.0)}
LIES: tuple[tuple[str, str, float], ...] = (
    ("open", "open", 0.0), ("shorted", "shorted", 0.0), ("frozen", "frozen", 0.0), ("reversed", "reversed", 0.0),
    ("stuck where it is, ±2 codes", "stuck", math.nan), ("stuck at code 1000, ±2", "stuck", 1000.0),
    ("offset, step of 5 mV", "offset", 5e-3), ("offset, step of 50 mV", "offset", 50e-3),
    ("offset, step of 0.5 V", "offset", 0.5), ("drift of 0.1 V/s", "drift", 0.1 / 4000.0),
    ("drift of 10 V/s", "drift", 10.0 / 4000.0), ("gain a half", "gain", 0.5), ("gain a tenth", "gain", 0.1),
    ("gain doubled", "gain", 2.0), ("lag of 1 ms", "lag", 4.0), ("lag of 10 ms", "lag", 40.0),
    ("the next channel's reading", "swapped", 1.0), ("bit 4 turned over", "bit", 4.0),
    ("bit 10 turned over", "bit", 10.0), ("an end stop at 1 mm", "end stop", 1.0),
)  # fmt: skip
BEFORE, AFTER, RATE_HZ = 900, 6000, 4000.0
AFTER_S = AFTER / RATE_HZ
DOCS = Path(__file__).resolve().parents[3] / "docs" / "decisions" / "0706-rest-by-the-model-and-by-the-reading.md"
BEGIN, END = "<!-- lies: begin -->\n", "<!-- lies: end -->\n"


@dataclass(frozen=True)
class Noticed:
    """Of one lie in one situation: what the guard named within AFTER ticks (empty: it did not notice), after how long,
    and how far from rest the motor was at most."""

    lie: str
    situation: str
    name: str
    after_ms: float
    furthest_mm: float


def try_lie(lie: tuple[str, str, float], situation: str) -> Noticed:
    """One lie, on the first channel, in one situation."""
    hertz, amplitude = SITUATIONS[situation]
    guarded = Guarded(designed())
    time_s = np.arange(BEFORE + AFTER) / RATE_HZ
    wave = amplitude * np.sin(2.0 * np.pi * hertz * time_s)
    other = 0.5 * amplitude * np.sin(2.0 * np.pi * 1.7 * hertz * time_s)
    rows = np.stack([wave, other, other], axis=1)
    assert guarded.run(rows[:BEFORE]).fault is Fault.NONE
    guarded.break_sensor(lie[1], 0, lie[2])
    run = guarded.run(rows[BEFORE:])
    furthest = float(np.max(np.abs(run.displacement_mm[:, 0])))
    if run.fault_at is None:
        return Noticed(lie[0], situation, "", 0.0, furthest)
    return Noticed(lie[0], situation, run.fault.words.removeprefix("sensor "), 1e3 * run.fault_at / RATE_HZ, furthest)


def table() -> str:
    """The table as it stands in the documentation."""
    lines = ["| what the sensor does | " + " | ".join(SITUATIONS) + " |", "|---|" + "---|" * len(SITUATIONS)]
    for lie in LIES:
        cells = []
        for situation in SITUATIONS:
            found = try_lie(lie, situation)
            far = f"{found.furthest_mm:.2g} mm"
            after = f"{found.after_ms:.0f}" if found.after_ms >= 100.0 else f"{found.after_ms:.3g}"
            cells.append(
                f"{found.name}, {after} ms, {far}" if found.name else f"not promised: not in {AFTER_S:g} s, {far}"
            )
        lines.append(f"| {lie[0]} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the table into decision 0706."""
    before, rest = DOCS.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    DOCS.write_text(before + BEGIN + "\n" + table() + "\n" + END + after, encoding="utf-8")


if __name__ == "__main__":
    main()
