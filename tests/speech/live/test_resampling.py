"""The resampler between two clocks: its response, its servo, and what becomes of drop-outs."""

import numpy as np
import pytest

from tactuator.speech.live.resampling import ClockedResampler

RATE_OUT, COUNT, TARGET_S = 16000, 64, 0.003


def run(rate_in, signal, seconds, drift=0.0, jitter=lambda now_s: 0.0):
    """What comes out of a source's clock that is faster by `drift`; jitter: how late the source is at a time, or, below
    zero, the look at it."""
    resampler = ClockedResampler(rate_in, RATE_OUT, TARGET_S)
    out, given = [], 0
    for block in range(round(seconds * RATE_OUT / COUNT)):
        now_s = block * COUNT / RATE_OUT
        there = max(given, int(rate_in * (1.0 + drift) * (now_s - jitter(now_s))))
        resampler.push(signal(np.arange(given, there) / rate_in / (1.0 + drift)))
        given = there
        out.append(resampler.take(COUNT))
    return np.concatenate(out), resampler


@pytest.mark.parametrize("rate_in", [8000, 11025, 16000, 44100, 48000, 96000])
def test_resampler__a_tone_at_any_rate__the_same_tone_later_by_what_it_states(rate_in):
    out, resampler = run(rate_in, lambda t: np.sin(2 * np.pi * 1000 * t), 4.0)
    late_s = resampler.delay_s + TARGET_S + COUNT / RATE_OUT
    wanted = np.sin(2 * np.pi * 1000 * (np.arange(out.size) / RATE_OUT - late_s))
    whole_sample = 2 * np.pi * 1000 / rate_in  # a source gives whole samples
    np.testing.assert_allclose(out[2 * RATE_OUT :], wanted[2 * RATE_OUT :], atol=0.01 + whole_sample)
    amplitude = np.abs(np.fft.rfft(out[-RATE_OUT:] * np.hanning(RATE_OUT))[[1000, 999, 3000]])
    assert amplitude[2] < 1e-4 * amplitude[0]


@pytest.mark.parametrize("drift", [200e-6, -200e-6])
def test_resampler__clocks_apart__buffer_within_2_ms_and_drift_found(drift):
    _, resampler = run(48000, lambda t: np.sin(2 * np.pi * 440 * t), 60.0, drift)
    assert resampler.dropouts == 0
    assert resampler.worst_s < 0.002
    assert resampler.drift == pytest.approx(drift, abs=5e-6)


def test_resampler__a_source_held_up__one_drop_out_faded_and_the_buffer_as_before():
    def held_up(now_s):
        return now_s - 5.0 if 5.0 <= now_s < 5.1 else 0.0

    out, resampler = run(16000, lambda t: np.sin(2 * np.pi * 200 * t), 10.0, jitter=held_up)
    assert resampler.dropouts == 1
    assert abs(resampler.fill_s - resampler.target_s - COUNT / RATE_OUT) < 0.002 + COUNT / RATE_OUT
    steps = np.abs(np.diff(out))
    assert steps.max() < 1.3 * 2 * np.pi * 200 / RATE_OUT + 1.0 / (0.004 * RATE_OUT)


@pytest.mark.parametrize("drift", [0.0, 200e-6, -200e-6])
def test_resampler__looks_late_for_ten_seconds_and_then_not__no_drop_out(drift):
    rng = np.random.default_rng(2)

    def busy(now_s):
        return -rng.uniform(0.0, 0.02) if 2.0 < now_s < 12.0 and rng.random() < 0.5 else 0.0

    _, resampler = run(16000, lambda t: np.sin(2 * np.pi * 200 * t), 20.0, drift, busy)
    assert resampler.dropouts == 0
    assert resampler.worst_s < 0.002


def test_resampler__display_stood_still__one_drop_out_and_the_buffer_no_longer():
    def stood_still(now_s):
        return -0.5 if now_s >= 5.0 else 0.0

    _, resampler = run(16000, lambda t: np.sin(2 * np.pi * 200 * t), 20.0, jitter=stood_still)
    assert resampler.dropouts == 1
    assert resampler.target_s == TARGET_S
    assert resampler.worst_s < 0.002
