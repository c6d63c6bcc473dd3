"""What docs/assumptions.md says of the study, computed anew: each assumption twice as large, on the study's own files.

Arguments: the study's folder `files` (out/paper/files), and the page. The controller stays; the display that it is
judged on is changed. Seen to fail with a digit of the page changed.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import tactuator as tt
from tactuator.model.controller import Controller
from tactuator.model.description import Channel
from tactuator.paper.plan import PEOPLE
from tactuator.signals.discretise import discretise
from tactuator.signals.loop import FeedbackLoop
from tactuator.signals.loop_figures import margins
from tactuator.synthesis.objectives import judge

Change = Callable[[Channel], Channel]
HUM, NOISE, LOWEST, REACH = "felt hum", "felt noise", "level error, lowest level", "missing headroom"
FINGER = "change of |H|"


def of_environment(**factors: float) -> Change:
    """Return the change of a channel whose environment's figures are so many times as large."""

    def change(channel: Channel) -> Channel:
        environment = channel.environment
        changed: dict[str, Any] = {}
        for key, factor in factors.items():
            value = getattr(environment, key)
            changed[key] = tuple(factor * each for each in value) if isinstance(value, tuple) else factor * value
        return replace(channel, environment=replace(environment, **changed))

    return change


def of_load(key: str) -> Change:
    """Return the change of a channel whose finger has twice the mass, damping or stiffness."""
    return lambda channel: replace(
        channel, loads=tuple(replace(load, **{key: 2.0 * getattr(load, key)}) for load in channel.loads)
    )


CHANGES: dict[str, tuple[str, Change]] = {
    "hum at the sensor": (HUM, of_environment(hum_v_peak=2.0)),
    "noise at the sensor": (NOISE, of_environment(noise_v_rms=2.0)),
    "Coulomb friction": (LOWEST, of_environment(friction_v=2.0)),
    "presliding distance": (LOWEST, of_environment(presliding_v=2.0)),
    "step of the converters": (
        LOWEST,
        lambda channel: replace(channel, converter=replace(channel.converter, bits=channel.converter.bits - 1)),
    ),
    "travel": (REACH, lambda channel: replace(channel, travel_mm=2.0 * channel.travel_mm)),
    "mass of the finger": (FINGER, of_load("mass")),
    "damping of the finger": (FINGER, of_load("damping")),
    "stiffness of the finger": (FINGER, of_load("stiffness")),
}
"""What is twice as large, the finding that it changes, and how."""


def worst(controller: Controller, quantity: str, change: Change) -> float:
    """Return the worst value of a finding over the channels of the changed display."""
    display = controller.display
    changed = replace(display, channels=tuple(map(change, display.channels)))
    verdict = judge(replace(controller, display=changed))
    return max(
        finding.value
        for objective in verdict.objectives
        for finding in objective.findings
        if finding.quantity == quantity and finding.value is not None
    )


def phase_margin_deg(controller: Controller, delay_samples: int) -> float:
    """Return the smallest phase margin of the channels, unloaded."""
    found = []
    for channel in controller.display.channels:
        feedback = controller.channel(channel.name).feedback(controller.rate_hz)
        assert feedback is not None
        plant = discretise(channel.plant, controller.rate_hz, "zoh", delay_samples)
        found.append(margins(FeedbackLoop(feedback, plant)).phase_margin_deg)
    return min(found)


def figures(folder: Path) -> dict[str, tuple[float, float]]:
    """Return of every quantity what the page says: as it is, and twice as large."""
    controller = tt.read_controller(folder / "controller.json")
    found = {
        name: (worst(controller, quantity, lambda channel: channel), worst(controller, quantity, change))
        for name, (quantity, change) in CHANGES.items()
    }
    delay = controller.display.delay_samples
    found["computing delay"] = phase_margin_deg(controller, delay), phase_margin_deg(controller, 2 * delay)
    decades = math.log10(controller.display.channels[0].threshold.band_hz[0] / 20.0)
    offset, tilt = (float(np.mean([person[place] for person in PEOPLE.values()])) for place in (0, 1))
    found["tilt of the simulated subjects"] = offset + decades * tilt, offset + 2.0 * decades * tilt
    return found


def stated(page: Path) -> dict[str, tuple[float, float]]:
    """Return the two numbers that each row of the page's table ends with, by the row's quantity."""
    rows = {}
    for line in page.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and "→" in cells[-1]:
            before, after = cells[-1].replace("−", "-").split("→")
            rows[cells[0]] = float(before.split()[-1]), float(after.split()[0])
    return rows


def differences(folder: Path, page: Path) -> list[str]:
    """Return where page and study differ, by more than the last digit's rounding (and half a unit of processors)."""
    found, said = figures(folder), stated(page)
    missing = sorted(found.keys() ^ said.keys())
    off = [
        f"{name}: {said[name]}, is {tuple(round(value, 2) for value in values)}"
        for name, values in found.items()
        if name in said and not np.allclose(values, said[name], rtol=0.0, atol=0.1)
    ]
    return [*missing, *off]


def main() -> int:
    """Print where they differ, and the figures; return 0 where nothing does."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path)
    parser.add_argument("page", type=Path, nargs="?", default=Path("docs/assumptions.md"))
    given = parser.parse_args()
    for name, (before, after) in figures(given.files).items():
        print(f"{name}: {before:.2f} -> {after:.2f}")
    found = differences(given.files, given.page)
    print("\n".join(found) or "the page agrees")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
