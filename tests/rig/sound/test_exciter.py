"""The simulated exciter against its equations in continuous time."""

import numpy as np
import pytest

from tests.rig.sound.exciter import SUBSTEPS, Exciter, RunningExciter

RATE_HZ = 48000.0
QUIET = {"noise": 0.0, "hum": 0.0}


def moved_mm(exciter: Exciter, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    running = RunningExciter(exciter, RATE_HZ, np.random.default_rng(0))
    blocks = [running.answer(block) for block in np.array_split(share, 7)]
    sensor, felt = (np.concatenate(one) for one in zip(*blocks, strict=True))
    return exciter.sensor_full_scale * sensor, exciter.felt_full_scale_mm * felt


@pytest.mark.parametrize(
    "exciter",
    [
        Exciter(**QUIET),
        Exciter(60.0, 1.2, second_share=0.3, delay_s=0.04, high_pass_hz=30.0, **QUIET),
        Exciter(290.0, 30.0, second_hz=600.0, second_q=30.0, **QUIET),
    ],
)
def test_answer__to_many_tones__is_the_continuous_response(exciter: Exciter):
    count = 96000
    lines = np.arange(10, 1400, 14)
    spectrum = np.zeros(count // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(2j * np.pi * np.random.default_rng(1).uniform(size=lines.size))
    period = 1e-3 * np.fft.irfft(spectrum, count) * count / 2
    acceleration, felt = moved_mm(exciter, np.tile(period, 3))
    frequency = lines * RATE_HZ / count
    s = 2j * np.pi * frequency
    # held over a sample: the displacement is told at its end, the acceleration is the mean over it
    truth = exciter.response(frequency) * np.exp(0.5 * s / RATE_HZ) * exciter.volts
    step = np.exp(0.5 * s / SUBSTEPS / RATE_HZ)
    for heard, wanted in ((felt, truth * step), (acceleration, s**2 * exciter.response(frequency) * exciter.volts)):
        found = np.fft.rfft(heard[-count:])[lines] / np.fft.rfft(period)[lines]
        off = np.abs(found - wanted) / np.maximum(np.abs(wanted), 0.02 * np.max(np.abs(wanted)))
        assert np.max(off) < 0.012  # 0.1 dB


def test_answer__hardening_spring__pulls_back_harder_at_large_amplitude():
    push = np.full(96000, 0.5)
    soft, hard = (
        moved_mm(Exciter(100.0, 1.0, high_pass_hz=1e-4, hardening=h, drive=4e5, **QUIET), push)[1][-1] for h in (0, 2.0)
    )
    drive = 4e5 * 0.9
    stiffness = (2.0 * np.pi * 100.0) ** 2
    second = 4e5 * 0.1 / (2.0 * np.pi * 420.0) ** 2
    x = hard - second
    assert soft == pytest.approx(drive / stiffness + second, rel=5e-3)
    assert stiffness * (1.0 + 2.0 * x**2) * x == pytest.approx(drive, rel=5e-3)
    assert hard < 0.9 * soft
