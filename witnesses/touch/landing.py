"""A finger lands and is lifted: within 1 dB of the free display after 0.3 s of sound, never more than 1 dB too high.

The device is generator.c, which shares nothing with core's simulated display. It plays the same sound twice with the
same hum and noise: adaptive with the finger that comes and goes, and fixed with none. What is compared is the rms
through the threshold's curve in windows of 0.1 s (a period, for tones below 10 Hz). Only windows of 20 dB SL and more
count. Single tones may take 2 s. A run's first second does not count, in which the display and what it knows of the hum
begin from nothing: there speech was up to 1.44 dB too high. Seen to fail with --whole (all of the mass fed forward) and
with --fixed.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactuator.arrays import FloatArray
from tactuator.model.controller import ChannelController
from witnesses.touch import felt
from witnesses.touch.device import Device
from witnesses.touch.sounds import SOUNDS, spoken

RUN_S = 20.0
TONE_S = 14.0
BEGINNING_S = 1.0


@dataclass
class Tally:
    """The worst of many events: too high, dB, of what is judged and with what is quieter; settled after so much sound,
    and after so much time, s."""

    events: int = 0
    too_high_db: float = -np.inf
    quiet_db: float = -np.inf
    sound_s: float = 0.0
    clock_s: float = 0.0

    def add(
        self,
        change_db: FloatArray,
        free: FloatArray,
        moments: NDArray[np.int64],
        window_s: float = felt.WINDOW_S,
    ) -> None:
        """Take the events of a run: change_db of each window; free: its rms without a finger; moments: where one came
        or went.

        How long an event is felt is judged by the windows that begin after it and end before the next one.
        """
        rate_hz, across = felt.example().rate_hz, round(window_s * felt.example().rate_hz)
        sounds, quiet = felt.is_sound(free), free > felt.QUIET * np.max(free)
        self.too_high_db = max(self.too_high_db, float(np.max(change_db[sounds])))
        self.quiet_db = max(self.quiet_db, float(np.max(change_db[quiet])))
        bad = sounds & (np.abs(change_db) > 1.0)
        for moment, end in zip(moments, [*moments[1:], change_db.size + across], strict=True):
            self.events += 1
            late = np.flatnonzero(bad[moment : end - across])
            if late.size:
                self.clock_s = max(self.clock_s, (late[-1] + 1) / rate_hz)
                self.sound_s = max(self.sound_s, float(np.sum(sounds[moment : moment + late[-1] + 1])) / rate_hz)


def presses(rng: np.random.Generator, samples: int) -> NDArray[np.int32]:
    """Return 1 where a finger touches: stretches of 1.2 to 2.2 s with and without, which begin at any moment."""
    rate_hz = felt.example().rate_hz
    lengths = np.round(rng.uniform(1.2, 2.2, 2 + round(samples / rate_hz)) * rate_hz).astype(int)
    return np.resize(np.repeat(np.arange(lengths.size) % 2, lengths), samples).astype(np.int32)


def compare(
    rng: np.random.Generator,
    place: int,
    own: ChannelController,
    asked: FloatArray,
    touching: NDArray[np.int32],
    window_s: float = felt.WINDOW_S,
) -> tuple[FloatArray, FloatArray, NDArray[np.int64], bool]:
    """Return change (dB) and free rms of each window, the moments of events, and whether the range was reached."""
    channel, seed = felt.example().channels[place], int(rng.integers(2**31))
    free = Device(felt.example(), place, felt.fixed(place), seed).play(asked)
    played = Device(felt.example(), place, own, seed).play(asked, [felt.nominal(place)], touching)
    level, level_free = (felt.felt_over_time(channel, one.y_v, window_s) for one in (played, free))
    change_db = 20.0 * np.log10(level / level_free)
    level_free[: felt.times(BEGINNING_S).size] = 0.0
    moments = np.flatnonzero(np.diff(touching)) + 1
    full = bool(np.max(np.abs(played.command_v)) >= felt.FULL_V)
    return change_db, level_free, moments[moments < level.size], full


def chosen(given: argparse.Namespace, place: int) -> ChannelController:
    """Return the controller to judge: the designed one, or one that is to be found broken."""
    if given.fixed:
        return felt.fixed(place)
    return felt.adaptive(place, 1.0 if given.whole else None)


def judge(name: str, tally: Tally, sound_s: float) -> bool:
    """Print the lines of one kind of sound; tell whether all is kept."""
    print(f"{name}: {tally.events} events; settled after {tally.clock_s:.2f} s by the clock at the latest")
    print(f"{name}: too high by {tally.quiet_db:.2f} dB where what is quieter than 20 dB SL counts as well")
    return all(
        [
            felt.verdict(f"{name}: too high at most", tally.too_high_db, 1.0),
            felt.verdict(f"{name}: beyond 1 dB, after sound of", tally.sound_s, sound_s, "s"),
        ]
    )


def tones(given: argparse.Namespace, rng: np.random.Generator) -> bool:
    """Judge single tones of 2 to 298 Hz at 20 to 50 dB SL."""
    tally = Tally()
    for i in range(4 * given.count):
        place, level = i % 3, rng.uniform(20.0, 50.0)
        frequency = float(np.exp(rng.uniform(np.log(2.0), np.log(298.0))))
        time = felt.times(TONE_S)
        asked = 10.0 ** (level / 20.0) * np.sin(2.0 * np.pi * frequency * time)
        touching = np.resize(np.repeat([0, 1, 0], round(4.0 * felt.example().rate_hz)), time.size).astype(np.int32)
        window_s = max(felt.WINDOW_S, 1.0 / frequency)
        change_db, free, moments, full = compare(rng, place, chosen(given, place), asked, touching, window_s)
        if not full:
            tally.add(change_db, free, moments, window_s)
    return judge("single tones", tally, 2.0)


def main() -> int:
    """Print what is found of every kind of sound; return 0 where all is kept."""
    given = felt.arguments(
        __doc__,
        12,
        "runs of 20 s of each sound on each channel, about 11 events each",
        whole="feed forward all of the mass: broken",
        fixed="judge the fixed controller: broken",
    )
    rng = np.random.default_rng(given.seed)
    samples = felt.times(RUN_S).size
    kept = []
    for name, sound in SOUNDS.items():
        tally = Tally()
        for i in range(3 * given.count):
            asked, touching = sound(rng, samples), presses(rng, samples)
            tally.add(*compare(rng, i % 3, chosen(given, i % 3), asked, touching)[:3])
        kept.append(judge(name, tally, 0.3))
    for name, reference in spoken(given.speech).items():
        tally = Tally()
        for i in range(3 * given.count):
            asked = np.resize(np.roll(reference[:, i % 3], int(rng.integers(len(reference)))), samples)
            tally.add(*compare(rng, i % 3, chosen(given, i % 3), asked, presses(rng, samples))[:3])
        kept.append(judge(f"speech {name[:24]}", tally, 0.3))
    kept.append(tones(given, rng))
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
