"""Exciters drawn at random, and a rig with one on a card whose time is turned by hand."""

from collections.abc import Sequence

import numpy as np

from tactuator.io.csv_tables import resolve_curve
from tactuator.io.display import parse_display, with_curve
from tactuator.model.description import Display
from tactuator.perception.curve import ThresholdCurve
from tactuator.rig.sound.rig import SoundRig
from tactuator.rig.sound.simulated_card import Exciter, RunningExciter
from tactuator.rig.sound.stream import CardRows
from tactuator.runtime._core import ffi, lib

RATE_HZ = 48000.0
PERIOD = 1024


def drawn_exciter(seed: int) -> Exciter:
    """Resonance 50-300 Hz, Q 1-30, a second mode, delay 2-40 ms, high-pass 5-30 Hz, a spring that hardens."""
    rng = np.random.default_rng(seed)

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    resonance = log(50.0, 300.0)
    return Exciter(
        resonance_hz=resonance,
        q=log(1.0, 30.0),
        drive=log(1e4, 6e4),
        second_hz=resonance * rng.uniform(1.8, 4.0),
        second_q=log(3.0, 30.0),
        second_share=rng.uniform(0.03, 0.3),
        hardening=rng.uniform(0.0, 0.5),
        delay_s=rng.uniform(0.002, 0.040),
        high_pass_hz=log(5.0, 30.0),
        volts=2.0,
        sensor_full_scale=1e5,
        noise=rng.uniform(5.0, 50.0),
        hum=rng.uniform(0.0, 20.0),
    )


def exciter_display(exciter: Exciter, names: Sequence[str] = ("exciter",)) -> Display:
    """A display of accelerometers of 1 V for 1 m/s²."""
    full = 1e-3 * exciter.sensor_full_scale
    channel = {
        "sensor_gain_v_per_mm": 1e-3,
        "quantity": "acceleration",
        "travel_mm": 1.0,
        "plant": {"num": [1.0], "den": [1.0, 100.0, 1e6]},
    }
    return parse_display(
        {
            "display": {"name": "exciter", "rate_hz": RATE_HZ, "delay_samples": 0},
            "threshold": {"curve": "bolanowski-1988", "band_hz": [10.0, 400.0]},
            "feedback": {"structure": "none"},
            "converter": {"range_v": exciter.volts},
            "sound": {"output_full_scale_v": exciter.volts, "input_full_scale_v": full},
            "channel": [{"name": name, "output": k, "input": k, **channel} for k, name in enumerate(names, 1)],
        }
    )


def persons_curve() -> ThresholdCurve:
    """A synthetic person's: less sensitive by 4 dB at 10 Hz and by 14 dB at 400 Hz."""
    usual = resolve_curve("bolanowski-1988")
    frequency = usual.frequency_hz
    level = usual.level_db_re_1um + 4.0 + 10.0 * np.clip(np.log(frequency / 10.0) / np.log(40.0), 0.0, 1.0)
    return ThresholdCurve("S9", frequency, level, "measured", "synthetic")


class ExciterCard:
    """A card whose outputs drive exciters; its inputs hear the accelerometers, then the displacements."""

    def __init__(self, rows: CardRows, exciters: Sequence[Exciter], seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.rows = rows
        self.running = [RunningExciter(one, RATE_HZ, rng) for one in exciters]
        self.heard = np.zeros((PERIOD, 2 * len(exciters)), dtype=np.float32)
        self.owed = 0.0

    def sleep(self, seconds: float) -> None:
        self.owed += seconds * RATE_HZ
        while self.owed >= PERIOD:
            self.owed -= PERIOD
            out = np.zeros((PERIOD, len(self.running)), dtype=np.float32)
            given, taken = (ffi.from_buffer("float[]", one) for one in (self.heard, out))
            lib.tact_audio_callback(given, taken, PERIOD, ffi.NULL, 0, ffi.cast("tact_audio *", self.rows.address))
            answers = [one.answer(column.astype(float)) for one, column in zip(self.running, out.T, strict=True)]
            columns = [sensor for sensor, _ in answers] + [felt for _, felt in answers]
            self.heard = np.ascontiguousarray(np.column_stack(columns), dtype=np.float32)

    def close(self, alive: bool) -> None:
        pass


def exciter_rig(
    exciters: Sequence[Exciter], names: Sequence[str] = ("exciter",), seed: int = 0, curve: ThresholdCurve | None = None
) -> SoundRig:
    display = exciter_display(exciters[0], names)
    if curve is not None:
        display = with_curve(display, curve)
    rows = CardRows(len(exciters), 2 * len(exciters), 4 * 48000, RATE_HZ)
    card = ExciterCard(rows, exciters, seed)
    return SoundRig(display, rows, card, card.sleep)
