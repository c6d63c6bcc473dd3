"""Controllers with valid hashes and mutated figures."""

import copy
import hashlib
import json
from typing import Any

import numpy as np

EXTREMES = (0.0, -1.0, 1e-300, 1e6, -1e6, 1e300, 0.5, 2.0)


def forged(document: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Return the document with one to three figures of a channel changed, under a hash that fits."""
    made = copy.deepcopy({key: value for key, value in document.items() if key != "hash"})
    for _ in range(int(rng.integers(1, 4))):
        channel = made["channels"][int(rng.integers(len(made["channels"])))]
        place = int(rng.integers(5))
        if place == 0:
            channel["threshold_voltage_dc"] = _changed(channel["threshold_voltage_dc"], rng)
        elif place == 1:
            key = str(rng.choice(["command_v", "travel_v", "comfort_db_sl"]))
            channel["limits"][key] = _changed(channel["limits"][key], rng)
        elif place == 2:
            which = int(rng.integers(2))
            channel["anti_windup"]["gains"][which] = _changed(channel["anti_windup"]["gains"][which], rng)
        else:
            sections = channel["prefilter_sos" if place == 3 or channel["feedback_sos"] is None else "feedback_sos"]
            row, column = int(rng.integers(len(sections))), int(rng.integers(6))
            sections[row][column] = _changed(sections[row][column], rng)
    return resealed(made)


def resealed(document: dict[str, Any]) -> dict[str, Any]:
    """Return the document under a hash that fits its contents."""
    bare = {key: value for key, value in document.items() if key != "hash"}
    text = json.dumps(bare, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return {**bare, "hash": hashlib.sha256(text.encode()).hexdigest()}


def _changed(value: float, rng: np.random.Generator) -> float:
    kind = rng.random()
    if kind < 0.4:
        return float(rng.choice(EXTREMES))
    if kind < 0.7:
        return float(value * np.exp(rng.normal(0.0, 1.0)))
    return float(value * (1.0 + rng.normal(0.0, 1e-4)))
