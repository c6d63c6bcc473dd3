"""One exciter drawn at random, calibrated blind through PortAudio and a JACK server: JSON for a SEED.

The witness is the port that tells the displacement, which the calibration does not use, and the exciter's equations.
"""

import json
import sys
import time
from dataclasses import asdict

import numpy as np

from tactuator.errors import TactuatorError
from tactuator.measure.error import error_db
from tactuator.measure.open_loop import Calibrated, CalibrationRequest, _groups, calibrate, usable_band
from tactuator.measure.options import MeasurementOptions
from tactuator.measure.response import multisine_response
from tactuator.rig.open import open_rig
from tactuator.rig.sound.rig import SoundRig
from tactuator.rig.sound.simulated_card import Exciter, simulated_card
from tests.measure.open_loop.exciters import drawn_exciter, exciter_display

ASKED = CalibrationRequest((10.0, 400.0), 20.0, 50.0)
PERIOD = 4096


class Truth:
    """The exciter's volts of accelerometer for a volt, for small amplitudes."""

    def __init__(self, exciter: Exciter) -> None:
        self.exciter = exciter

    def response(self, frequency_hz: np.ndarray) -> np.ndarray:
        return 1e-3 * (2j * np.pi * frequency_hz) ** 2 * self.exciter.response(frequency_hz)


def felt_error_db(made: Calibrated, exciter: Exciter, rng: np.random.Generator) -> np.ndarray:
    """The felt level less what was asked, by the displacement itself, line by line."""
    display = exciter_display(exciter, felt=True)
    frequency = made.channels[0].last.frequency_hz
    band = made.controller.display.channels[0].threshold.band_hz
    options = MeasurementOptions(ASKED.level_db_sl, channels=["exciter"], mains_hz=50.0, band_hz=band, longest_s=12.0)
    found = []
    with open_rig("sound:-exciters", display) as rig:
        assert isinstance(rig, SoundRig)
        rig.feed_far_ahead()
        rig.load(made.controller)
        for group in _groups(made.controller, "exciter", frequency, ASKED.level_db_sl):  # none of which is cut
            (response,) = rig.repeated(lambda group=group: multisine_response(rig, group, options, rng, exactly=False))
            found.append(error_db(response, display))
    return np.concatenate(found)


def share_of_possible(made: Calibrated, exciter: Exciter) -> float:
    """The stated band's share, in octaves, of that which the exciter's own equations allow."""
    channel = exciter_display(exciter).channels[0]
    low, high = usable_band(channel, Truth(exciter), ASKED.band_hz, ASKED.level_db_sl).band_hz
    stated = made.channels[0].usable.band_hz
    common = np.log2(min(high, stated[1]) / max(low, stated[0]))
    return float(common / np.log2(high / low))


def blind(seed: int) -> dict[str, object]:
    """What came of one exciter."""
    exciter = drawn_exciter(seed)
    display = exciter_display(exciter)
    found: dict[str, object] = {"seed": seed, "exciter": asdict(exciter)}
    rng = np.random.default_rng(seed)
    with simulated_card([exciter], period=PERIOD, seed=seed):
        began = time.monotonic()
        try:
            with open_rig("sound:-exciters", display) as rig:
                assert isinstance(rig, SoundRig)
                made = calibrate(rig, ASKED, rng)
                found["gaps"] = rig.gaps
                found["minutes"] = rig._rows.frames / rig.rate_hz / 60.0
        except TactuatorError as error:
            return found | {"says": str(error), "wall_minutes": (time.monotonic() - began) / 60.0}
        found["wall_minutes"] = (time.monotonic() - began) / 60.0
        one = made.channels[0]
        felt = felt_error_db(made, exciter, rng)
        found |= {
            "flat": made.flat,
            "sensor_worst_db": one.last.worst_db,
            "first_worst_db": one.first.worst_db,
            "felt_worst_db": float(felt[np.argmax(np.abs(felt))]),
            "band_hz": one.usable.band_hz,
            "ends": one.usable.ends,
            "share": share_of_possible(made, exciter),
            "followed": one.followed.by,
            "departure_db": one.followed.departure_db,
            "rounds": one.rounds,
            "level_v": one.level.volts,
        }
    return found


if __name__ == "__main__":
    sys.stdout.write(json.dumps(blind(int(sys.argv[1]))) + "\n")
