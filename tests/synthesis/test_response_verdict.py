"""Verdicts on open loops designed from magnitudes alone, against beams whose response is held out (`beams`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactuator.io.display import read_display
from tactuator.model.verdict import Finding, Outcome
from tactuator.signals.decibels import db
from tactuator.synthesis.design import design_controller
from tactuator.synthesis.verdict import judge
from tests.model.beams import Beam, drawn

RATE_HZ, BAND_HZ = 8000.0, (8.0, 300.0)
DENSE = np.geomspace(*BAND_HZ, 4000)
DISPLAY = """
[display]
name = "beam"
rate_hz = 8000
[threshold]
curve = "bolanowski-1988"
band_hz = [8.0, 300.0]
[feedback]
structure = "none"
[[channel]]
name = "tip"
sensor_gain_v_per_mm = 1.0
travel_mm = 2.0
plant = "response.csv"
"""


def designed(
    folder: Path, beam: Beam, points: int, rng: np.random.Generator, noise_db: float = 0.1
) -> tuple[Finding, float]:
    """Return the finding on flatness of a design from `points` noisy magnitudes, and the true greatest error, dB."""
    frequency = np.geomspace(7.9, 305.0, points)
    level = np.abs(beam.response(frequency)) * 10.0 ** (noise_db * rng.standard_normal(points) / 20.0)
    rows = [f"{f!r},{m!r},{1.96 * noise_db}" for f, m in zip(frequency.tolist(), level.tolist(), strict=True)]
    (folder / "response.csv").write_text("frequency_hz,magnitude,confidence_db\n" + "\n".join(rows) + "\n")
    (folder / "display.toml").write_text(DISPLAY)
    display = read_display(folder / "display.toml")
    made = design_controller(display, None, 0.4)
    prefilter = made.channels[0].prefilter(RATE_HZ).response(DENSE)
    moved = np.abs(prefilter * np.sinc(DENSE / RATE_HZ) * beam.response(DENSE))
    true_db = np.max(np.abs(db(moved / display.channels[0].threshold_voltage(DENSE))))
    return judge(made).objectives[0].findings[0], float(true_db)


def test_judge__beam_of_eighty_points__met_and_true(tmp_path: Path) -> None:
    found, true_db = designed(tmp_path, Beam(60.0, 0.15), 80, np.random.default_rng(1))
    assert found.outcome is Outcome.MET
    assert true_db <= 1.0


def test_judge__too_few_points_for_a_notch__not_judged_and_where_to_measure(tmp_path: Path) -> None:
    found, _ = designed(tmp_path, Beam(60.0, 0.06), 30, np.random.default_rng(1))
    assert found.outcome is Outcome.NOT_JUDGED
    low, high = (float(part) for part in found.remark.split("between ")[1].removesuffix(" Hz").split(" and "))
    assert 7.9 <= low < high <= 305.0
    assert "more points of its response" in found.remark


@pytest.mark.soak
@pytest.mark.parametrize("points", [40, 80])
def test_judge__100_beams__nothing_met_that_is_not(tmp_path: Path, points: int) -> None:
    rng = np.random.default_rng(0)
    outcomes = []
    for _ in range(100):
        found, true_db = designed(tmp_path, drawn(rng), points, rng)
        assert found.outcome is not Outcome.MET or true_db <= 1.0
        assert found.outcome is not Outcome.NOT_MET or true_db > 1.0
        outcomes.append(found.outcome)
    assert outcomes.count(Outcome.MET) >= (10 if points == 40 else 50)
