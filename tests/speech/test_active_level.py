"""The active level, against an implementation of ITU-T P.56 sample by sample, written from its text alone."""

import math

import numpy as np
import pytest
import soundfile

from tactuator.speech.active_level import active_level
from tactuator.speech.band_codings import DirectCoding
from tactuator.speech.reading import sample_path
from tactuator.speech.spoken import speech_signal

RATE_HZ = 4000


def p56(samples, rate_hz):
    """ITU-T P.56, method B, its section 8, of mean power: (level in dB of the rms re 1, activity factor)."""
    g, hang, margin = math.exp(-1.0 / (rate_hz * 0.03)), math.ceil(rate_hz * 0.2), 15.9
    thresholds = [2.0**j for j in range(-25, 10)]
    counts, since = [0] * len(thresholds), [hang] * len(thresholds)
    total = p = q = 0.0
    for x in samples.tolist():
        total += x * x
        p = g * p + (1.0 - g) * abs(x)
        q = g * q + (1.0 - g) * p
        for j, c in enumerate(thresholds):
            if q >= c:
                counts[j] += 1
                since[j] = 0
            elif since[j] < hang:
                counts[j] += 1
                since[j] += 1
            else:
                break
    before = None
    for c, a in zip(thresholds, counts, strict=True):
        if a == 0:
            break
        level, least = 10.0 * math.log10(total / a), 20.0 * math.log10(c)
        if level - least <= margin:
            if before is not None:
                share = (before[0] - margin) / (before[0] - (level - least))
                level = before[1] + share * (level - before[1])
            return level, total / len(samples) / 10.0 ** (level / 10.0)
        before = (level - least, level)
    raise AssertionError("no crossing")


def spoken(seed, seconds=4.0):
    """Syllables of harmonics of a voice, of many strengths, with pauses and some noise."""
    rng, time = np.random.default_rng(seed), np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    wave, at = np.zeros(time.size), rng.uniform(0.0, 0.4)
    while at < seconds - 0.3:
        length, pitch = rng.uniform(0.08, 0.3), rng.uniform(80.0, 250.0)
        inside = (time >= at) & (time < at + length)
        t = time[inside] - at
        tone = sum(np.sin(2 * np.pi * k * pitch * t + rng.uniform(0, 6)) / k for k in range(1, 8))
        wave[inside] += rng.uniform(0.3, 1.0) * np.sin(np.pi * t / length) ** 0.5 * tone
        at += length + rng.choice([0.02, 0.1, 0.6], p=[0.5, 0.3, 0.2])
    return rng.uniform(0.01, 1.0) * (wave + rng.uniform(0.0, 0.01) * rng.standard_normal(time.size))


def measured(samples, cut=(1 << 30,)):
    return active_level(lambda: iter(np.split(samples[:, None], list(cut))), RATE_HZ)


@pytest.mark.parametrize("seed", range(30))
def test_level__speech_of_30_kinds__is_p56_within_0_3_db(seed):
    samples = spoken(seed)
    level, share = p56(samples, RATE_HZ)
    got = measured(samples)
    assert got.level_db - 10.0 * math.log10(2.0) == pytest.approx(level, abs=0.3)
    assert got.share == pytest.approx(share, abs=0.03)
    assert not any("left out" in note for note in got.notes)


def test_level__shipped_sample__is_p56():
    samples, rate = soundfile.read(sample_path())
    got = active_level(lambda: iter([samples[:, None]]), rate)
    assert got.level_db - 10.0 * math.log10(2.0) == pytest.approx(p56(samples, rate)[0], abs=0.3)


@pytest.mark.parametrize("seed", range(20))
def test_level__a_thump_of_10_to_40_db__within_1_db_or_said(seed):
    rng, samples = np.random.default_rng(100 + seed), spoken(seed)
    level = p56(samples, RATE_HZ)[0]
    thump_db, length, at = rng.uniform(10.0, 40.0), rng.uniform(0.01, 0.06), rng.uniform(0.0, 3.9)
    k = np.arange(int(length * RATE_HZ))
    thump = np.sin(2 * np.pi * rng.uniform(60, 290) * k / RATE_HZ) * np.hanning(k.size)
    thump *= 10.0 ** ((level + thump_db) / 20.0) / np.sqrt(np.mean(thump**2))
    first = int(at * RATE_HZ)
    spoilt = samples.copy()
    spoilt[first : first + k.size] += thump
    got = measured(spoilt)
    error_db = got.level_db - 10.0 * math.log10(2.0) - level
    assert abs(error_db) < 1.0
    assert thump_db < 15.0 or any("left out" in note for note in got.notes)


@pytest.mark.parametrize("seed", range(40))
def test_level__a_knock_little_above_the_loudest_syllables__within_1_db_or_said(seed):
    rng = np.random.default_rng(900 + seed)
    samples = spoken(seed, rng.uniform(2.0, 6.0))
    assert measured(samples).notes == ()
    level, t = p56(samples, RATE_HZ)[0], np.arange(int(rng.uniform(0.15, 0.4) * RATE_HZ)) / RATE_HZ
    knock = np.exp(-t / (t[-1] / 9.0)) * np.sin(2 * np.pi * rng.uniform(30.0, 120.0) * t)
    first = int(rng.uniform(0.0, 0.9) * (samples.size - t.size))
    samples[first : first + t.size] += 10.0 ** ((level + rng.uniform(16.0, 21.0)) / 20.0) * knock / np.abs(knock).max()
    got = measured(samples)
    assert abs(got.level_db - 10.0 * math.log10(2.0) - level) < 1.0 or any("a knock?" in note for note in got.notes)


def uneven(seed, seconds=4.0):
    """Speech with words of very different strengths: what is loudest may be no knock."""
    rng, samples = np.random.default_rng(500 + seed), spoken(seed, seconds)
    strengths = 10.0 ** (rng.uniform(-30.0, 0.0, int(seconds / 0.4) + 1) / 20.0)
    return samples * np.repeat(strengths, round(0.4 * RATE_HZ))[: samples.size]


@pytest.mark.parametrize("seed", range(20))
def test_level__words_of_unlike_strengths__is_p56_or_says_what_was_left_out(seed):
    samples = uneven(seed)
    got = measured(samples)
    if not any("left out" in note for note in got.notes):
        assert got.level_db - 10.0 * math.log10(2.0) == pytest.approx(p56(samples, RATE_HZ)[0], abs=0.3)


@pytest.mark.parametrize("seed", range(20))
def test_level__a_long_knock_in_a_short_recording__within_1_db_or_said(seed):
    """A slammed door of 0.1 to 0.2 s takes up to a tenth of the time, and hides the speech from P.56."""
    seconds, rng = 1.6 + 0.1 * seed, np.random.default_rng(700 + seed)
    samples = spoken(seed, seconds)
    level, t = p56(samples, RATE_HZ)[0], np.arange(int(rng.uniform(0.1, 0.2) * RATE_HZ)) / RATE_HZ
    slam = rng.standard_normal(t.size) * np.exp(-t / (t[-1] / 3.0))
    slam *= 10.0 ** ((level + rng.uniform(15.0, 40.0)) / 20.0) / np.sqrt(np.mean(slam**2))
    first = int(rng.uniform(0.0, seconds - 0.2) * RATE_HZ)
    samples[first : first + t.size] += slam
    got = measured(samples)
    assert abs(got.level_db - 10.0 * math.log10(2.0) - level) < 1.0 or any("a knock?" in note for note in got.notes)


@pytest.mark.parametrize("noise_db", [-60.0, -40.0])
@pytest.mark.parametrize("seconds", [20.0, 60.0])
def test_level__speech_before_a_long_pause__is_p56_and_not_taken_for_a_knock(seconds, noise_db):
    samples, rng = spoken(5, 4.0), np.random.default_rng(5)
    level = p56(samples, RATE_HZ)[0]
    noise = 10.0 ** ((level + noise_db) / 20.0) * rng.standard_normal(int(seconds * RATE_HZ))
    got = measured(np.r_[samples, noise])
    assert got.level_db - 10.0 * math.log10(2.0) == pytest.approx(level, abs=0.5)
    assert not any("left out" in note for note in got.notes)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("above_db", [0.0, 6.0, 12.0])
def test_level__hum_or_noise_as_strong_as_the_speech__is_said(seed, above_db):
    samples, rng = spoken(seed), np.random.default_rng(seed)
    rms, time = 10.0 ** ((p56(samples, RATE_HZ)[0] + above_db) / 20.0), np.arange(samples.size) / RATE_HZ
    steady = math.sqrt(2.0) * np.sin(2 * np.pi * 50.0 * time), rng.standard_normal(samples.size)
    assert not any("hardly falls" in note for note in measured(samples).notes)
    for each in steady:
        assert any("hardly falls" in note for note in measured(samples + rms * each).notes)


def test_level__however_it_is_cut__same_and_silence_has_none():
    samples = spoken(3)
    assert measured(samples, (1, 99, 100, 4001, 9000)).level_db == pytest.approx(measured(samples).level_db, abs=1e-9)
    silent = measured(np.zeros(4000))
    assert (silent.level_db, silent.share, silent.notes) == (-np.inf, 0.0, ())
    two = np.stack([spoken(1), 10.0 * spoken(2)], axis=1)
    assert active_level(lambda: iter([two]), RATE_HZ).level_db == measured(two[:, 1]).level_db


def test_render__thump_in_quiet_speech__speech_is_at_its_level_and_the_thump_is_named(write_sound, controller):
    """`quiet-with-a-thump.wav`: asked for 35 dB SL, the speech used to come to 0."""
    rate, seconds = 16000, 2
    time = np.arange(seconds * rate) / rate
    turns = 2 * np.pi * np.cumsum(120 + 10 * np.sin(2 * np.pi * 0.7 * time)) / rate
    voice = sum(np.sin(k * turns) / k for k in range(1, 20)) * np.clip(np.sin(4 * np.pi * time), 0, None) ** 0.7
    quiet, k = 0.01 * voice / np.abs(voice).max(), np.arange(int(0.02 * rate))
    quiet[-2000 : -2000 + k.size] += 0.95 * np.sin(2 * np.pi * 150 * k / rate) * np.hanning(k.size)
    with speech_signal(write_sound(quiet, rate), controller, DirectCoding(), 35.0) as signal:
        asked = np.concatenate([block.copy() for block in signal.blocks])[:, 0]
    assert [note for note in signal.notes if "left out of its level" in note]
    assert [note for note in signal.notes if "a knock?" in note]
    whole = asked[: int(1.8 * controller.rate_hz)]
    level = p56(whole, controller.rate_hz)[0] + 10.0 * math.log10(2.0)
    assert level == pytest.approx(35.0, abs=1.0)
