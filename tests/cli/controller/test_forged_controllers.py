"""Whatever `check` calls met, `build` accepts; a valid hash makes no forged figure good."""

import copy
import hashlib
import json
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.controller import parse_controller
from tactuator.model.controller import Controller
from tactuator.model.verdict import Outcome
from tactuator.synthesis.verdict import whole_verdict
from tactuator.wordlength.assessment import built
from tests.synthesis.displays import paper_controller, three_finger_controller

EXTREMES = (0.0, -1.0, 1e-300, 1e6, -1e6, 1e300, 0.5, 2.0)


def forged(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Return the document with one to three figures of a channel changed, under a hash that fits."""
    forgery = copy.deepcopy(document)
    for _ in range(int(rng.integers(1, 4))):
        channel = forgery["channels"][int(rng.integers(len(forgery["channels"])))]
        place = int(rng.integers(5))
        sections = channel["prefilter_sos" if place == 3 or channel["feedback_sos"] is None else "feedback_sos"]
        part, key = [
            (channel, "threshold_voltage_dc"),
            (channel["limits"], str(rng.choice(["command_v", "travel_v", "comfort_db_sl"]))),
            (channel["anti_windup"]["gains"], int(rng.integers(2))),
            *(2 * [(sections[int(rng.integers(len(sections)))], int(rng.integers(6)))]),
        ][place]
        part[key] = _changed(part[key], rng)
    return resealed(forgery)


def resealed(document: dict[str, Any]) -> dict[str, Any]:
    """Return the document under a hash that fits its contents."""
    bare = {key: value for key, value in document.items() if key != "hash"}
    text = json.dumps(bare, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return {**bare, "hash": hashlib.sha256(text.encode()).hexdigest()}


def _changed(value: float, rng: np.random.Generator) -> float:
    kind = rng.random()
    if kind < 0.4:
        return float(rng.choice(EXTREMES))
    return float(value * (np.exp(rng.normal(0.0, 1.0)) if kind < 0.7 else 1.0 + rng.normal(0.0, 1e-4)))


def judged(document: dict[str, object]) -> str:
    """Return what becomes of a forged controller; fails where `check` and `build` part."""
    try:
        controller = parse_controller(document)
        for channel, described in zip(controller.channels, controller.display.channels, strict=True):
            assert channel.threshold_voltage_dc > 0.0
            assert 0.0 < channel.limits.command_v <= described.converter.range_v * 1.001
            assert channel.limits.travel_v > 0.0
            assert 0.0 < channel.limits.comfort_db_sl <= controller.display.objectives.comfort_db_sl * 1.001
        verdict = whole_verdict(controller)
    except BadInput:
        return "refused"
    if verdict.outcome is not Outcome.NOT_MET:
        assert built(controller, "float32")[0]
    return verdict.outcome.value


def tally(count: int, seed: int) -> Counter[str]:
    """Return what became of forgeries of a channel with a load and every disturbance stated, so that it can be met."""
    three, rng = three_finger_controller(), np.random.default_rng(seed)
    display = replace(three.display, channels=three.display.channels[:1])
    document = Controller(display, three.channels[:1], three.tool).document()
    return Counter(judged(forged(document, rng)) for _ in range(count))


@pytest.mark.parametrize(("count", "seed"), [(25, 1), pytest.param(10_000, 2, marks=pytest.mark.soak)])
def test_check__forged_controllers__what_is_met_is_built(count: int, seed: int) -> None:
    counted = tally(count, seed)
    assert min(counted["refused"], counted["met"], counted["not met"]) > count // 20


def test_controller__limit_of_a_million_volts__refused_with_a_hash_that_fits_too() -> None:
    """It used to be called met."""
    document = paper_controller().document()
    document["channels"][0]["limits"]["command_v"] = 1e6
    with pytest.raises(BadInput, match="hash"):
        parse_controller(document)
    with pytest.raises(BadInput, match=r"limits: command_v is 1e\+06; allowed: above 0, at most 10 V"):
        parse_controller(resealed(document))
