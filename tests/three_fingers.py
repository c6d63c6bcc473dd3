"""A display document with three fingers: the paper's index finger and two siblings."""

from __future__ import annotations

from tests.runtime.paper_display import FINGERS


def three_finger_display(rate_hz: float = 4000.0) -> dict[str, object]:
    return {
        "display": {"name": "three fingers", "rate_hz": rate_hz, "delay_samples": 1},
        "threshold": {"curve": "bolanowski-1988", "band_hz": [0.4, 300.0]},
        "feedback": {"structure": "paper"},
        "channel": [
            {
                "name": name,
                "finger": name,
                "sensor_gain_v_per_mm": gain,
                "travel_mm": 12.5,
                "plant": {"num": [num], "den": list(den)},
                "loads": [{"name": "finger", "mass": load[0], "damping": load[1], "stiffness": load[2]}],
            }
            for name, gain, num, den, load in FINGERS
        ],
    }
