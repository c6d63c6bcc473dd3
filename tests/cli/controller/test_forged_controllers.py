"""Whatever `check` calls met, `build` accepts; a valid hash makes no forged figure good."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactuator.cli import main
from tactuator.errors import BadInput
from tactuator.io.controller import parse_controller
from tactuator.model.controller import Controller
from tactuator.model.verdict import Outcome
from tactuator.synthesis.verdict import whole_verdict
from tactuator.wordlength.assessment import built
from tests.cli.controller.forged import forged, resealed
from tests.synthesis.displays import paper_controller, three_finger_controller


def judged(document: dict[str, object]) -> str:
    """Return what becomes of a forged controller; fails where `check` and `build` part."""
    try:
        made = parse_controller(document)
    except BadInput:
        return "refused"
    for own, described in zip(made.channels, made.display.channels, strict=True):
        assert own.threshold_voltage_dc > 0.0
        assert 0.0 < own.limits.command_v <= described.converter.range_v * 1.001
        assert own.limits.travel_v > 0.0
        assert 0.0 < own.limits.comfort_db_sl <= made.display.objectives.comfort_db_sl * 1.001
    try:
        verdict = whole_verdict(made)
    except BadInput:
        return "refused"
    if verdict.outcome is Outcome.NOT_MET:
        return "not met"
    image, _ = built(made, "float32")
    assert image
    return verdict.outcome.value


def tally(count: int, made: Controller, seed: int) -> dict[str, int]:
    """Return how many forged controllers were refused, not met, met or not judged."""
    rng = np.random.default_rng(seed)
    document = made.document()
    found: dict[str, int] = {}
    for _ in range(count):
        outcome = judged(forged(document, rng))
        found[outcome] = found.get(outcome, 0) + 1
    return found


def one_loaded_finger() -> Controller:
    """A channel with a load and every disturbance stated, so that a forged controller can be met."""
    three = three_finger_controller()
    return Controller(replace(three.display, channels=three.display.channels[:1]), three.channels[:1], three.tool)


def test_check__forged_controllers__what_is_met_is_built() -> None:
    found = tally(25, one_loaded_finger(), 1)
    assert min(found["refused"], found["met"], found["not met"]) > 2


@pytest.mark.soak
def test_check__10_000_forged_controllers__what_is_met_is_built() -> None:
    found = tally(10_000, one_loaded_finger(), 2)
    assert min(found["refused"], found["met"], found["not met"]) > 500


def test_check__limit_of_a_million_volts__refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It used to be called met."""
    document = paper_controller().document()
    document["channels"][0]["limits"]["command_v"] = 1e6
    with pytest.raises(BadInput, match="hash"):
        parse_controller(document)
    with pytest.raises(BadInput, match=r"limits: command_v is 1e\+06; allowed: above 0, at most 10 V"):
        parse_controller(resealed(document))
    (tmp_path / "c.json").write_text("{}")
    assert main(["check", str(tmp_path / "c.json")]) == 2
    assert "format is None" in capsys.readouterr().err
