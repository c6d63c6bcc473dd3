"""Held or band-limited: records as others make them, under both assumptions; slopes of the held response."""

from dataclasses import replace

import numpy as np
import pytest

from tactuator.identification.form import Form, stages_of
from tactuator.identification.hold import Grid, held_slopes, response_columns
from tactuator.identification.identify import identify
from tactuator.identification.options import Fixed
from tactuator.identification.result import resonances
from tactuator.identification.trust import FASTEST, HOLD
from tactuator.signals.record import Record
from tests.identification.others import Plant, band_limited, held

RESONATOR = Plant(np.zeros(0), np.array([-42.65 + 435.0j, -42.65 - 435.0j]), 2.0, 0.0)
"""The resonator of 69.5 Hz whose band-limited record at 610.35 Hz, read as held, is wrong by decibels."""
LATE = Plant(np.array([-900.0]), np.array([-60.0 + 500.0j, -60.0 - 500.0j, -300.0]), 0.7, 1.3e-3)
RATE_HZ = 610.35


def logarithm_off(found, plant, frequency):
    return np.log(found.model.response(frequency) / plant.response(frequency))


@pytest.fixture(scope="module")
def filtered() -> Record:
    return Record(RATE_HZ, *band_limited(RESONATOR, np.random.default_rng(1), RATE_HZ, 10.0, 40.0))


def test_identify__recorded_through_filters__is_named_and_right_within_its_band(filtered: Record) -> None:
    found = identify(filtered)
    assert (found.between.hold, found.between.certain, found.between.source) == ("band-limited", True, "data")
    assert not found.distrust
    assert (found.order, found.model.num.size - 1, found.model.delay_s) == (2, 0, 0.0)
    frequency = np.geomspace(1.0, 0.3 * RATE_HZ, 100)
    off = logarithm_off(found, RESONATOR, frequency)
    assert np.max(np.abs(off.real)) * 8.686 < 0.05
    assert np.max(np.abs(np.degrees(off.imag))) < 1.0
    assert np.mean(np.abs(off.real) * 8.686 <= found.model.band_db(frequency)) > 0.8
    assert np.mean(np.abs(off.imag) <= found.model.band_rad(frequency)) > 0.8
    (pair,) = resonances(found.model.den)
    assert pair.q == pytest.approx(abs(RESONATOR.poles[0]) / (2.0 * 42.65), rel=0.02)


def test_identify__filtered_record__is_trusted_no_more_than_it_may(filtered) -> None:
    said = replace(filtered, about={"hold": "band-limited"})
    assert identify(said, order=2, zeros=0).between.source == "file"
    kept = identify(filtered, hold="band-limited", order=3, zeros=1, fixed=(Fixed("delay_s", 1e-4),))
    assert (kept.order, kept.model.num.size - 1, kept.model.delay_s) == (3, 1, pytest.approx(1e-4))
    fast = identify(filtered, hold="band-limited", order=3, zeros=0)
    assert np.max(fast.poles_hz) > 0.5 * RATE_HZ
    assert any(FASTEST.name in reason for reason in fast.distrust)
    # read as held it is wrong by decibels; what the form cannot follow is in the band
    wrong, frequency = identify(filtered, hold="zero-order", order=2), np.geomspace(1.0, 0.3 * RATE_HZ, 100)
    assert np.max(np.abs(logarithm_off(wrong, RESONATOR, frequency))) * 8.686 > 1.0
    assert np.max(wrong.model.band_db(frequency)) > 0.5


def test_identify__held_record_with_dead_time__is_named_and_right() -> None:
    record = Record(1000.0, *held(LATE, np.random.default_rng(2), 1000.0, 8.0, 40.0))
    found = identify(record)
    assert (found.between.hold, found.between.certain) == ("zero-order", True)
    assert not found.distrust
    assert found.order == 3
    frequency = np.geomspace(1.0, 300.0, 100)
    off = logarithm_off(found, LATE, frequency)
    assert np.max(np.abs(off.real)) * 8.686 < 0.1
    assert np.max(np.abs(np.degrees(off.imag))) < 1.0
    assert found.model.delay_s == pytest.approx(1.3e-3, abs=1e-4)


def test_identify__half_order_part__hold_is_not_told_by_a_form_that_does_not_fit() -> None:
    """Eddy currents beside 60 Hz, Q 3, by FFT on a finer grid. The hold was *band-limited*, certain, 13° off."""
    rng, rate_hz, fine, count = np.random.default_rng(0), 2000.0, 16, 6000
    command = 0.7 * np.repeat(rng.choice([-1.0, 0.0, 1.0], count // 50), 50)
    hertz = np.fft.rfftfreq(1 << 18, 1.0 / (rate_hz * fine))
    s = 2j * np.pi * hertz / 377.0
    response = 1.0 / (s * s + s / 3.0 + 1.0) / (1.0 + 0.274 * s**0.5)
    place = hertz / (rate_hz * fine)
    lines = np.fft.rfft(np.repeat(command, fine), 1 << 18) * response * np.sinc(place) * np.exp(-1j * np.pi * place)
    position = np.fft.irfft(lines, 1 << 18)[: count * fine : fine]
    found = identify(Record(rate_hz, command, position + 0.003 * position.std() * rng.standard_normal(count)))
    assert (found.between.hold, found.between.certain) == ("zero-order", False)
    at_hz = np.geomspace(2.0, found.model.valid_hz[1], 50)
    s = 2j * np.pi * at_hz / 377.0
    off = np.log(found.model.response(at_hz) * (s * s + s / 3.0 + 1.0) * (1.0 + 0.274 * s**0.5))
    assert np.all(np.abs(off.imag) <= found.model.band_rad(at_hz) + 0.012)


def test_identify__slow_plant_at_a_high_rate__hold_unknown_and_the_band_holds_both() -> None:
    late = replace(RESONATOR, delay_s=0.4e-3)
    record = Record(12000.0, *band_limited(late, np.random.default_rng(3), 12000.0, 1.5, 30.0))
    found = identify(record, order=2, zeros=0)
    assert not found.between.certain
    assert found.other is not None
    (row,) = (row for row in found.model.trust if row.name == HOLD.name)
    assert (row.beyond, row.decides) == (True, "cannot tell")
    frequency = np.geomspace(5.0, 400.0, 50)
    off = logarithm_off(found, late, frequency)
    assert np.mean(np.abs(off.imag) <= found.model.band_rad(frequency)) > 0.9
    # both signals fall off below half the rate: taken as band-limited, which half a sample (7 degrees here) tells
    assert found.between.hold == "band-limited"
    assert np.max(np.abs(off.imag)) < np.radians(2.0)
    prompt = Record(12000.0, *held(late, np.random.default_rng(3), 12000.0, 1.0, 30.0))
    without_filters = identify(prompt, order=2, zeros=0)
    assert (without_filters.between.hold, without_filters.between.certain) == ("zero-order", False)
    assert np.max(np.abs(logarithm_off(without_filters, late, frequency).imag)) < np.radians(2.0)


def test_identify__noisy_loop_with_its_reference__keeps_the_loops_noise_out() -> None:
    plant = Plant(np.array([-150.0]), np.array([-60.0 + 500.0j, -60.0 - 500.0j]), 1.5, 0.0)
    signals = band_limited(plant, np.random.default_rng(5), RATE_HZ, 10.0, 8.0, True, True)
    frequency = np.geomspace(2.0, 0.3 * RATE_HZ, 100)
    off = []
    for reference in (None, signals[2]):
        record = Record(RATE_HZ, signals[0], signals[1], reference=reference)
        found = identify(record, order=2, zeros=1, fixed=(Fixed("delay_s", 0.0),), hold="band-limited")
        off.append(float(np.sqrt(np.mean(np.abs(logarithm_off(found, plant, frequency)) ** 2))))
    assert off[1] < 0.4 * off[0]
    assert any("follows the recorded reference" in remark for remark in found.remarks)


def test_identify__reference_that_commands_nothing__is_not_used(filtered: Record) -> None:
    alone = identify(filtered, order=2, zeros=0, hold="band-limited")
    idle = replace(filtered, reference=np.random.default_rng(0).standard_normal(filtered.command.size))
    beside = identify(idle, order=2, zeros=0, hold="band-limited")
    np.testing.assert_array_equal(alone.model.den, beside.model.den)


@pytest.mark.slow
def test_identify__exciter_heard_late__second_mode_and_dead_time_are_found() -> None:
    """High-pass, two modes, acceleration, 120 samples of dead time: as many zeros as poles, and late."""
    first, second = 90.0 * 2.0 * np.pi, 210.0 * 2.0 * np.pi
    modes = [size * np.array([-0.08 + 1j, -0.08 - 1j]) for size in (first, second)]
    zeros = np.concatenate([1.4 * first * np.array([-0.05 + 1j, -0.05 - 1j]), [-1e-3, -1e-3, -1e-3]])
    late = Plant(zeros, np.concatenate([*modes, [-60.0]]), 1e-12, 0.08)
    record = Record(1500.0, *band_limited(late, np.random.default_rng(9), 1500.0, 7.0, 45.0))
    found = identify(record, hold="band-limited", quantity="acceleration")
    assert found.order in (5, 6)
    assert found.model.delay_s == pytest.approx(0.08, abs=2e-5)
    frequency = np.geomspace(20.0, 400.0, 100)
    assert np.max(np.abs(logarithm_off(found, late, frequency))) < 0.05


FORMS = {
    "a dead time": (Form(3, 1, True), [0.3, 1.1, 0.7], 0.4),
    "hardly damped": (Form(2, 0), [0.01, 2.0], 0.0),
    "as many zeros as poles": (Form(4, 4, True), [0.3, 1.1, 1.7, 0.6], 0.9),
    "an integrator": (Form(2, 0, False, 1), [0.7], 0.3),
    "an unstable pair": (Form(3, 2, True, 0, 1), [-0.1, 1.0, 30.0], 0.01),
}


@pytest.mark.parametrize("name", FORMS)
def test_held_slopes__every_form__are_those_of_the_response(name: str) -> None:
    form, coefficients, delay = FORMS[name]
    theta = np.array(coefficients)
    grid = Grid(np.geomspace(1.0, 480.0, 200), 1000.0, 2.0 * np.pi * 60.0, "zero-order")
    stages, numerator = stages_of(theta, form), np.random.default_rng(0).standard_normal(form.numerators)

    def response(at: np.ndarray, late: float) -> np.ndarray:
        return response_columns(grid, at, late, form, stages) @ numerator

    found = held_slopes(grid, theta, delay, form, stages, numerator, np.full(theta.size, 1e-7))
    moves = [(step, 0.0, step.sum()) for step in 1e-5 * np.eye(theta.size) * np.maximum(np.abs(theta), 0.1)]
    moves += [(np.zeros(theta.size), 1e-5, 1e-5)] * form.dead_time
    for j, (step, late, size) in enumerate(moves):
        expected = (response(theta + step, delay + late) - response(theta - step, delay - late)) / (2.0 * size)
        np.testing.assert_allclose(found[:, j], expected, atol=1e-4 * float(np.max(np.abs(expected))))


def test_held_slopes__poles_that_coincide__are_left_to_differences() -> None:
    form, theta = Form(2, 0), np.array([2.0, 1.0])
    grid = Grid(np.array([1.0, 50.0]), 1000.0, 300.0, "zero-order")
    assert held_slopes(grid, theta, 0.0, form, stages_of(theta, form), np.ones(1), np.full(2, 1e-7)) is None
