"""Bad input by `listen` for ten minutes in all: comfort and travel at the finger port, computed here.


Shouts, pops, square waves of full scale, noise, music, silence and NaN, at gains far beyond comfort, onto the simulated
display with and without its finger load. Felt: displacement weighted by the inverse of the threshold curve's file, with
zero phase, in stretches. Run: python -m witnesses.live.limits CONTROLLER [SECONDS].
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import tactuator as tt

FloatArray = NDArray[np.float64]

RATE_IN, COMFORT_DB, TRAVEL_MM, STRETCH = 16000, 55.0, 12.5, 1 << 18
CURVE = Path(tt.__file__).parent / "perception" / "data" / "digitised-bolanowski-1988-thenar.csv"


def threshold_mm(hertz: Any) -> FloatArray:
    """The curve in millimetres, straight in dB over the logarithm of frequency, held beyond its ends."""
    rows = [line.split(",") for line in CURVE.read_text().splitlines() if line[:1].isdigit()]
    points = np.array([[float(cell) for cell in row[:2]] for row in rows])
    level = np.interp(np.log(np.maximum(hertz, 1e-3)), np.log(points[:, 0]), points[:, 1])
    return np.asarray(1e-3 * 10.0 ** (level / 20.0))


def felt_of(moved_mm: FloatArray, rate_hz: float) -> FloatArray:
    """Threshold units, of stretches that overlap by a half, of which the middle is kept."""
    half, quarter = STRETCH // 2, STRETCH // 4
    weight = 1.0 / threshold_mm(np.fft.rfftfreq(STRETCH, 1.0 / rate_hz))
    padded = np.concatenate((np.full(quarter, moved_mm[0]), moved_mm, np.full(STRETCH, moved_mm[-1])))
    taper = np.sin(0.5 * np.pi * np.minimum(1.0, np.arange(STRETCH) / quarter)) ** 2
    taper *= taper[::-1]
    parts = []
    for at in range(0, len(moved_mm), half):
        part = np.fft.irfft(np.fft.rfft(padded[at : at + STRETCH] * taper) * weight)
        parts.append(part[quarter : quarter + half])
    return np.concatenate(parts)[: len(moved_mm)]


def bad_sound(seconds: float) -> FloatArray:
    """Ten kinds of sound, a second each, again and again, at other levels and frequencies every time."""
    rng, parts, time = np.random.default_rng(2), [], np.arange(RATE_IN) / RATE_IN
    for second in range(round(seconds)):
        hertz, size = rng.uniform(3.0, 400.0), 10.0 ** rng.uniform(-1.0, 0.0)
        tone = np.sin(2 * np.pi * hertz * time)
        pops = np.where(rng.random(RATE_IN) < 1e-3, rng.choice([-1.0, 1.0], RATE_IN), 0.0)
        shout = size * tone * (time > 0.3) + 0.3 * rng.standard_normal(RATE_IN)
        music = sum(np.sin(2 * np.pi * each * time * (1 + 0.01 * np.sin(time))) for each in rng.uniform(30, 2000, 6))
        kinds = (np.sign(tone), pops, shout, 0.2 * music, np.zeros(RATE_IN), rng.standard_normal(RATE_IN),
                 np.sign(tone) * (time % 0.2 < 0.1), np.full(RATE_IN, size), 3.0 * tone,
                 np.where(pops, np.nan, tone))  # fmt: skip
        parts.append(kinds[second % len(kinds)])
    return np.concatenate(parts)


class Sound:
    """A source as `listen` takes one: samples at their own pace."""

    rate_hz, piece_s, ended = RATE_IN, 0.0, False
    notes: tuple[str, ...] = ()

    def __init__(self, samples: FloatArray) -> None:
        self._samples, self._at = samples, 0

    def read(self, now_s: float) -> FloatArray:
        first, self._at = self._at, int(now_s * RATE_IN)
        self.ended = self._at >= len(self._samples)
        return self._samples[first : self._at]

    def close(self) -> None:
        self.ended = True


def main() -> None:
    controller = tt.read_controller(sys.argv[1])
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 150.0
    for coding, load in (("direct", None), ("direct", "finger"), ("bands", None), ("envelope", None)):
        rig = tt.SimulatedRig(controller.display, seed=3)
        moved: dict[str, list[FloatArray]] = {name: [] for name in rig.channels}
        for name, pieces in moved.items():
            rig.finger(name).attach(pieces.append)
            rig.finger(name).touch(load)
        state = (
            tt.listen(rig, controller, Sound(bad_sound(seconds)), coding=coding, gain_db=95.0, fast=True).run().state
        )
        for name, pieces in moved.items():
            whole = np.concatenate(pieces)
            most_db, most_mm = 20 * np.log10(np.abs(felt_of(whole, rig.rate_hz)).max()), np.abs(whole).max()
            met = "kept" if most_db <= COMFORT_DB and most_mm <= TRAVEL_MM else "NOT KEPT"
            words = (
                f"{most_db:.2f} dB SL, {most_mm:.2f} mm; limiter {state.taken_back_s:.0f} s of {state.seconds:.0f} s"
            )
            print(f"{coding}, {load or 'no load'}, {name}: {words}; {state.not_numbers} NaN: {met}", flush=True)


if __name__ == "__main__":
    main()
