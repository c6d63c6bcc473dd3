"""Every method says between which frequencies its model holds, and a display that is given the model knows it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from tactuator.identification.asked import Asked
from tactuator.identification.identify import identify, judged
from tactuator.identification.prepared import ExcitationReport, prepared, valid_range
from tactuator.identification.result import Identification
from tactuator.identification.trust import FOLLOWING, VALID
from tactuator.signals.record import Record
from tests.identification.plants import PAPER, RATE_HZ

TOP_HZ, LATE = 60.0, 20


def simulated(command: np.ndarray) -> np.ndarray:
    num, den, _ = signal.cont2discrete((PAPER.num, PAPER.den), 1.0 / RATE_HZ, "zoh")
    return np.asarray(signal.lfilter(num.ravel(), den, command))


@pytest.fixture(scope="module")
def record() -> Record:
    """The paper's plant, simulated by scipy, moved below 60 Hz alone."""
    rng = np.random.default_rng(5)
    source = rng.standard_normal(round(6.0 * RATE_HZ))
    command = signal.sosfiltfilt(signal.butter(8, TOP_HZ, output="sos", fs=RATE_HZ), source)
    position = simulated(command)
    noise = 1e-3 * position.std() * rng.standard_normal(position.size)
    return Record(RATE_HZ, command, position + noise)


@pytest.fixture(scope="module", params=["refined", "rls"])
def found(record: Record, request: pytest.FixtureRequest) -> Identification:
    return identify(record, method=request.param, order=2)


def test_identify__command_without_power_above_a_frequency__claims_nothing_above(found: Identification) -> None:
    low, high = found.model.valid_hz
    assert low < 2.0
    assert 0.7 * TOP_HZ < high < 2.0 * TOP_HZ


def test_identify__record_s_own_response__is_in_the_model_s_units(found: Identification) -> None:
    """The figure draws both: in samples of unit size the dots stood decibels away from the curve."""
    shown = found.empirical.trusted(0.9)
    beside = shown.frequency_hz < 0.7 * TOP_HZ
    ratio = np.abs(shown.value / found.model.response(shown.frequency_hz))[beside]
    assert np.median(np.abs(np.log(ratio))) < 0.02


def test_judged__band_wide_everywhere__is_a_reason(record: Record) -> None:
    found = identify(record, method="rls", order=2)
    wide = replace(found.model, valid_hz=(1.0, 1.05))
    common = replace(prepared([record], Asked()), excitation=ExcitationReport(9, 3, 1.0, 50.0))
    reasons = judged(replace(found, model=wide), common).distrust
    assert any(VALID.name in one for one in reasons)


def test_valid_range__band_narrow_nowhere__is_two_neighbours(record: Record) -> None:
    found = identify(record, method="rls", order=2)
    model = replace(found.model, covariance=1e12 * found.model.covariance)
    low, high = valid_range(model, (1.0, 60.0))
    assert low < high < 1.1 * low


def test_identify__least_squares_of_a_plant_with_dead_time__is_not_trusted() -> None:
    command = np.random.default_rng(8).standard_normal(6000)
    late = Record(RATE_HZ, command[LATE:], simulated(command)[:-LATE])
    assert any(FOLLOWING.name in one for one in identify(late, method="rls", order=2).distrust)
    prompt = Record(RATE_HZ, command, simulated(command))
    assert not identify(prompt, method="rls", order=2).distrust
