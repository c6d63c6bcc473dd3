"""Streams at other rates, and band filters: against closed forms and whole-signal filtering."""

import numpy as np
import pytest
from scipy import signal

from tactuator.errors import BadInput
from tactuator.speech.band_codings import DirectCoding, band_limit_kernel
from tactuator.speech.filters import band_kernel, filter_bank, filter_columns, resample
from tests.speech.rendered import cut


@pytest.mark.parametrize("rate_in", [4000, 8000, 11025, 44100, 47999, 192000])
def test_resample__tone__same_tone_without_delay(rate_in):
    count = rate_in // 2 + 17
    tone = np.sin(2 * np.pi * 210.0 * np.arange(count) / rate_in + 0.3)
    got = np.concatenate(list(resample([tone], rate_in, 4000, 300.0)))
    assert len(got) == int(np.ceil(count * 4000 / rate_in))
    expected = np.sin(2 * np.pi * 210.0 * np.arange(len(got)) / 4000 + 0.3)
    np.testing.assert_allclose(got[100:-100], expected[100:-100], atol=1e-4)


@pytest.mark.parametrize("frequency", [3700.0, 3900.0, 4250.0, 7900.0])
def test_resample__tone_that_would_fold_into_the_band__90_db_down(frequency):
    tone = np.sin(2 * np.pi * frequency * np.arange(32000) / 16000)
    got = np.concatenate(list(resample([tone], 16000, 4000, 300.0)))
    assert np.abs(got[200:-200]).max() < 10 ** (-85 / 20)


@pytest.mark.parametrize("rate_in", [3000, 11025, 44100])
def test_resample__however_it_is_cut__is_whole(rate_in):
    noise = np.random.default_rng(3).standard_normal(2 * rate_in + 5)
    pieces = np.concatenate(list(resample(cut(noise, [700, 5000, 1]), rate_in, 4000, 300.0)))
    np.testing.assert_allclose(pieces, np.concatenate(list(resample([noise], rate_in, 4000, 300.0))), atol=1e-12)


@pytest.mark.parametrize("lengths", [[30011], [1, 20000], [4097], [700, 5000, 1]])
def test_filter_bank__however_it_is_cut__is_whole_convolution(lengths):
    noise = np.random.default_rng(2).standard_normal(30011)
    kernels = [band_kernel(0.0, 300.0, 30.0, 4000.0), band_kernel(50.0, 200.0, 20.0, 4000.0)]
    got = np.concatenate(list(filter_bank(cut(noise, lengths), kernels)))
    for column, kernel in zip(got.T, kernels, strict=True):
        np.testing.assert_allclose(column, signal.fftconvolve(noise, kernel, "same"), atol=1e-12)


def test_filter_columns__two_columns__each_as_by_itself():
    noise = np.random.default_rng(3).standard_normal((12345, 2))
    kernel = band_kernel(0.0, 290.0, 20.0, 4000.0)
    got = np.concatenate(list(filter_columns(cut(noise, [5000]), kernel)))
    for column in range(2):
        alone = np.concatenate(list(filter_bank([noise[:, column]], [kernel])))[:, 0]
        np.testing.assert_allclose(got[:, column], alone, atol=1e-13)
    assert list(filter_columns([], kernel)) == []


def test_direct__its_filter__flat_inside_and_gone_from_300_hz():
    coding = DirectCoding()
    low, high = (coding.low_hz, coding.low_transition_hz), (coding.high_hz, coding.high_transition_hz)
    kernel = band_limit_kernel(low, high, 4000.0)
    np.testing.assert_allclose(kernel, kernel[::-1], atol=1e-15)
    inside = np.abs(signal.freqz(kernel, worN=np.linspace(3.0, 280.0, 300), fs=4000.0)[1])
    outside = np.abs(signal.freqz(kernel, worN=np.r_[np.linspace(0, 1, 50), np.linspace(300, 2000, 900)], fs=4000.0)[1])
    assert np.abs(20 * np.log10(inside)).max() < 0.002
    assert 20 * np.log10(outside.max()) < -80.0


@pytest.mark.parametrize("band", [(10.0, 5.0, 1.0), (0.0, 1995.0, 20.0), (0.0, 100.0, 0.0), (0.5, 100.0, 2.0)])
def test_band_kernel__edges_that_do_not_fit__refused(band):
    with pytest.raises(BadInput, match="; "):
        band_kernel(*band, 4000.0)
    with pytest.raises(BadInput, match="does not fit"):
        list(resample([np.ones(100)], 500, 4000, 300.0))
