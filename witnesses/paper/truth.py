"""The study's controller, found end to end, against one that is designed for the known truth: felt levels at 10, 30 and
50 dB SL, free and touched, all channels. The worst levels are within 0.15 dB of each other, and so is every point up to
the confidence of both measurements (0.3 dB each at 10 dB SL, 0.1 dB above).

Arguments: summary.json of `make reproduce`. Its measured volts are compared with those of the same device, frequencies
and seeds under the other controller: no model, calibration or prediction of the study enters. Seen to fail with
--motor-db 1, which designs for motors that are 1 dB off.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import tactuator as tt
from tactuator.api.parameters import paper_display
from tactuator.api.response import MeasuredResponses
from tactuator.model.description import Display
from tactuator.paper.measured import CONFIDENCE_DB
from tactuator.paper.plan import RESPONSE_HZ, Plan, default_display

LEVELS_DB_SL, LOADS = (10.0, 30.0, 50.0), ("none", "finger")
MOST_DB = 0.15


def off(display: Display, motor_db: float) -> Display:
    """Return the display with motors of more gain."""
    channels = tuple(
        replace(channel, plant=replace(channel.plant, gain=channel.plant.gain * 10.0 ** (motor_db / 20.0)))
        for channel in display.channels
    )
    return replace(display, channels=channels)


def points(found: dict[str, Any], channel: str, load: str, level: float) -> dict[str, np.ndarray]:
    """Return a measured run of the study, each column (n,)."""
    rows = [
        point
        for point in found["response"]["ours"]
        if (point["channel"], point["load"], point["level_db_sl"]) == (channel, load, level)
    ]
    assert [row["frequency_hz"] for row in rows] == list(RESPONSE_HZ)
    return {name: np.array([row[name] for row in rows]) for name in ("measured_v", "ci_db", "saturated")}


def main() -> int:
    """Print worst levels and the greatest difference of every run; return 1 where one is beyond MOST_DB."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("summary", type=Path)
    parser.add_argument("--motor-db", type=float, default=0.0, help="how far off the motors designed for are: broken")
    given = parser.parse_args()
    found = json.loads(given.summary.read_text())
    plan = Plan(paper_display(), found["seed"])
    known = tt.design(default_display(off(plan.display, given.motor_db)))
    together, most = 1.0 - 0.01 / (len(RESPONSE_HZ) * len(plan.display.channels)), 0.0
    print("load     dB SL  channel   felt minus asked: end to end, truth known   greatest difference")
    for load in LOADS:
        for level in LEVELS_DB_SL:
            rig = tt.SimulatedRig(plan.display, plan.seed_of(f"response at {level:g} dB SL, {load}"))
            measured = tt.measure_response(
                rig, known, RESPONSE_HZ, level, load, confidence_db=CONFIDENCE_DB[level], coverage=together
            )
            assert isinstance(measured, MeasuredResponses)
            for channel, response in zip(plan.display.channels, measured.responses, strict=True):
                ours = points(found, channel.name, load, level)
                asked = channel.threshold_voltage(np.array(RESPONSE_HZ)) * 10.0 ** (level / 20.0)
                both = (ours["measured_v"], response.magnitude_v)
                levels = [20.0 * np.log10(each / asked)[~ours["saturated"]] for each in both]
                worst = [float(np.max(np.abs(each))) for each in levels]
                unsure = (ours["ci_db"] + response.confidence_db)[~ours["saturated"]]
                beyond = float(np.max(np.abs(levels[0] - levels[1]) - unsure))
                apart = float(np.max(np.abs(levels[0] - levels[1])))
                most = max(most, abs(worst[0] - worst[1]), beyond)
                print(f"{load:8} {level:5g}  {channel.name:8} {worst[0]:25.2f}, {worst[1]:.2f} {apart:28.2f}")
    print(f"at most {most:.2f} dB apart, allowed {MOST_DB:g} dB")
    return int(most > MOST_DB)


if __name__ == "__main__":
    sys.exit(main())
