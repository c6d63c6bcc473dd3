"""Exciters drawn at random, and a rig with one on a card whose time is turned by hand."""

from collections.abc import Sequence

import numpy as np

from tactuator.io.csv_tables import resolve_curve
from tactuator.io.display import with_curve
from tactuator.model.description import Display
from tactuator.perception.curve import ThresholdCurve
from tactuator.rig.sound.rig import SoundRig
from tactuator.rig.sound.stream import CardRows
from tests.rig.sound.exciter import Exciter, RunningExciter
from tests.rig.sound.turned_card import TurnedCard, sound_display

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
    plant = {"num": [1.0], "den": [1.0, 100.0, 1e6]}
    channel = {"sensor_gain_v_per_mm": 1e-3, "quantity": "acceleration", "plant": plant}
    scale = {"output_full_scale_v": exciter.volts, "input_full_scale_v": 1e-3 * exciter.sensor_full_scale}
    return sound_display(names, RATE_HZ, exciter.volts, channel, **scale)


def persons_curve() -> ThresholdCurve:
    """A synthetic person's: less sensitive by 4 dB at 10 Hz and by 14 dB at 400 Hz."""
    usual = resolve_curve("bolanowski-1988")
    frequency = usual.frequency_hz
    level = usual.level_db_re_1um + 4.0 + 10.0 * np.clip(np.log(frequency / 10.0) / np.log(40.0), 0.0, 1.0)
    return ThresholdCurve("S9", frequency, level, "measured", "synthetic")


def exciter_card(rows: CardRows, exciters: Sequence[Exciter], seed: int) -> TurnedCard:
    """A card whose outputs drive exciters; its inputs hear the accelerometers, then the displacements."""
    rng = np.random.default_rng(seed)
    running = [RunningExciter(one, RATE_HZ, rng) for one in exciters]

    def answer(out: np.ndarray) -> np.ndarray:
        answers = [one.answer(column.astype(float)) for one, column in zip(running, out.T, strict=True)]
        return np.column_stack([column for kind in zip(*answers, strict=True) for column in kind]).astype(np.float32)

    return TurnedCard(rows, PERIOD, answer, rate_hz=RATE_HZ, period=PERIOD, inputs=2 * len(exciters))


def exciter_rig(
    exciters: Sequence[Exciter], names: Sequence[str] = ("exciter",), seed: int = 0, curve: ThresholdCurve | None = None
) -> SoundRig:
    display = exciter_display(exciters[0], names)
    if curve is not None:
        display = with_curve(display, curve)
    rows = CardRows(len(exciters), 2 * len(exciters), 4 * 48000, RATE_HZ)
    card = exciter_card(rows, exciters, seed)
    return SoundRig(display, rows, card, card.sleep)
