"""Simulate, estimate, recover: many plants, open and closed loop, friction; what is said of disputed fixed values."""

import numpy as np
import pytest
from scipy import optimize, signal

from tactuator.errors import BadInput
from tactuator.identification.fixed_values import FixedAgainstOwn, checks_against_own
from tactuator.identification.identify import identify
from tactuator.identification.options import Fixed, IdentifyOptions
from tactuator.identification.recursive import identify_recursively
from tactuator.model.plant_model import PlantModel
from tactuator.signals.excitation import log_chirp, prbs, steps
from tactuator.signals.record import Record
from tests.identification.plants import PAPER, RATE_HZ, closed_loop, open_loop

BAND_HZ = np.geomspace(0.4, 300.0, 200)


def error_db(found, plant, frequency=BAND_HZ):
    return 20.0 * np.log10(np.abs(found.model.response(frequency) / plant.response(frequency)))


def test_identify__coloured_noise_in_closed_loop__only_least_squares_is_biased() -> None:
    rng = np.random.default_rng(11)
    record = closed_loop(PAPER, rng, 12.0, noise=0.3, colour=0.7)
    refined, plain = identify(record, order=2), identify(record, order=2, method="rls")
    assert np.max(np.abs(error_db(refined, PAPER))) < 0.4
    assert np.max(np.abs(error_db(plain, PAPER))) > 2.0 * np.max(np.abs(error_db(refined, PAPER)))
    assert refined.tests.white
    assert refined.tests.uncorrelated_with_input


def test_identify__output_error_with_scipy__agrees() -> None:
    rng = np.random.default_rng(12)
    record = open_loop(PAPER, rng, 6.0)
    found = identify(record)

    def residual(theta):
        b, a, _ = signal.cont2discrete(([2875.0 * theta[0]], [1.0, 94.0 * theta[1], 290.0 * theta[2]]), 1.0 / RATE_HZ)
        return record.position - signal.lfilter(b[0], a, record.command)

    assert found.friction is None  # there is none, and none is claimed
    peer = optimize.least_squares(residual, [0.9, 1.1, 1.2]).x * [2875.0, 94.0, 290.0]
    ours = np.array([found.model.num[0], *found.model.den[1:]])
    # both within a small part of the standard error of each other
    half_widths = found.model.confidence()
    limits = np.array([half_widths["num_s0"], half_widths["den_s1"], half_widths["den_s0"]])
    assert np.all(np.abs(ours - peer) < 0.2 * limits)


def test_identify__strong_noise__feedback_is_seen_or_cannot_be_told() -> None:
    for loop, feedback in ((closed_loop, True), (open_loop, None)):
        record = loop(PAPER, np.random.default_rng(26), 5.0, noise=3.0)
        tests = identify(record, order=2).tests
        assert (tests.feedback, tests.feedback_is) == (feedback, "likely: yes" if feedback else "unknown")


def test_identify__slow_process_with_dead_time__delay_is_found() -> None:
    rng = np.random.default_rng(16)
    command = steps(4000.0, 1.0, 60.0, rng)
    system = signal.cont2discrete(([2e-3], [1.0, 0.08, 0.0008]), 1.0)
    clean = np.concatenate([np.zeros(12), signal.lfilter(system[0][0], system[1], command)[:-12]])
    found = identify(Record(1.0, command, clean + 0.01 * clean.std() * rng.standard_normal(4000)))
    assert found.model.delay_s == pytest.approx(12.0, abs=1.0)
    assert found.model.band_hz[1] == pytest.approx(0.45)


@pytest.mark.parametrize("kind", [pytest.param("step", marks=pytest.mark.slow), "chirp", "prbs"])
def test_identify__other_excitations__recover_the_plant(kind: str) -> None:
    rng = np.random.default_rng(17)
    command = {
        "step": np.concatenate([np.zeros(4000), np.ones(16000)]),
        "chirp": log_chirp(5.0, RATE_HZ, 0.4, 300.0),
        "prbs": prbs(5.0, RATE_HZ, 1000.0, rng),
    }[kind]
    clean = signal.lfilter(*PAPER.sampled(), command)
    found = identify(Record(RATE_HZ, command, clean + 1e-3 * clean.std() * rng.standard_normal(command.size)))
    assert found.order == 2
    assert np.max(np.abs(error_db(found, PAPER))) < 0.05


@pytest.mark.parametrize("kind", ["few sines through a filter", "sweep behind coupling by capacitors"])
def test_identify__command_of_few_bands__filters_and_hold_are_found(kind: str) -> None:
    """Of sines between a record's lines every band has one, and shows the response at that sine, not in its middle. The
    slow end of a quick sweep is as smooth as a transient: bands show nothing there, and the record by itself does.
    """
    rng, rate_hz, turn = np.random.default_rng(1), 2000.0, 2.0 * np.pi * 60.0
    time = np.arange(12000) / rate_hz
    if kind.startswith("few"):
        phases = np.outer(2.0 * np.pi * np.geomspace(1.0, 700.0, 60), time) + rng.uniform(0.0, 2.0 * np.pi, (60, 1))
        command, (top, under) = 0.09 * np.cos(phases).sum(axis=0), signal.butter(2, 2.0 * np.pi * 200.0, analog=True)
    else:
        command, top = 0.7 * signal.chirp(time, 1.0, 6.0, 700.0), [1.0, 0.0, 0.0]
        under = np.polymul([1.0, 2.0 * np.pi * 5.0], [1.0, 2.0 * np.pi])
    top, under = np.polymul([turn**2], top), np.polymul([1.0, turn / 3.0, turn**2], under)
    clean = signal.dlsim((*signal.cont2discrete(signal.tf2ss(top, under), 1.0 / rate_hz)[:4], 1.0 / rate_hz), command)
    position = clean[1][:, 0] + 0.003 * clean[1].std() * rng.standard_normal(12000)
    found = identify(Record(rate_hz, command, position))
    assert not found.model.distrust
    assert (found.between.hold, found.between.certain) == ("zero-order", True)
    assert found.model.valid_hz[1] > 600.0
    at_hz = np.geomspace(max(1.0, found.model.valid_hz[0]), found.model.valid_hz[1], 200)
    s = 2j * np.pi * at_hz
    off = np.log(found.model.response(at_hz) * np.polyval(under, s) / np.polyval(top, s))
    assert np.all(np.abs(off.real) * 8.686 <= found.model.band_db(at_hz) + 0.01)
    assert np.all(np.abs(off.imag) <= found.model.band_rad(at_hz) + 1e-3)


def test_identify__acceleration__zeros_at_the_origin() -> None:
    rng = np.random.default_rng(19)
    command = rng.standard_normal(5000)
    system = signal.cont2discrete(signal.tf2ss([5.0, 0.0, 0.0], [1.0, 40.0, 4e4]), 1.0 / RATE_HZ)
    clean = signal.dlsim((*system[:4], 1.0 / RATE_HZ), command)[1][:, 0]
    record = Record(RATE_HZ, command, clean + 0.02 * clean.std() * rng.standard_normal(5000))
    found = identify(record, quantity="acceleration")
    for written, taken in (("acceleration", "acceleration"), ("warmth", "displacement")):  # in a file, as `record` does
        assert IdentifyOptions(order=2).of({"quantity": written}).quantity == taken
    with pytest.raises(BadInput, match="order is 1 for the acceleration; it must be 2 to 8"):
        IdentifyOptions(order=1).of({"quantity": "acceleration"})
    assert (found.order, found.model.quantity) == (2, "acceleration")
    np.testing.assert_array_equal(found.model.num[1:], 0.0)
    np.testing.assert_allclose(found.model.num, [5.0, 0.0, 0.0], rtol=0.01)
    np.testing.assert_allclose(found.model.den, [1.0, 40.0, 4e4], rtol=0.02)


def short(count: int) -> Record:
    record = open_loop(PAPER, np.random.default_rng(21), 2.0, noise=1e-3)
    return Record(RATE_HZ, record.command[:count], record.position[:count])


@pytest.mark.parametrize(
    ("record", "match"),
    [
        (Record(RATE_HZ, np.random.default_rng(0).standard_normal(5000), np.zeros(5000)), "position is constant"),
        (Record(RATE_HZ, np.zeros(10), np.zeros(10)), "100 or more"),
        (Record(RATE_HZ, np.zeros(2), np.zeros(2)), "100 or more"),
        (short(800), "time constant"),
    ],
)
def test_identify__record_that_cannot_tell__is_refused(record: Record, match: str) -> None:
    with pytest.raises(BadInput, match=match):
        identify(record, order=2)


@pytest.mark.parametrize(
    "asked",
    [{"order": 0}, {"order": 9}, {"zeros": -1}, {"integrators": 9}]
    + [{name: "guess"} for name in ("hold", "method", "quantity")],
)
def test_identify__unknown_option__is_refused(asked) -> None:
    with pytest.raises(BadInput, match="; "):
        identify(short(2000), **asked)


def test_recursive__paper_plant__is_recovered() -> None:
    record = open_loop(PAPER, np.random.default_rng(23), 20.0, noise=1e-3)
    found = identify_recursively(record.command, record.position, RATE_HZ)
    np.testing.assert_allclose(found.den, PAPER.den, rtol=2e-3)
    assert found.num[0] == pytest.approx(2875.0, rel=2e-3)
    with pytest.raises(BadInput, match="fewer zeros"):
        identify_recursively(record.command, record.position, RATE_HZ, poles=2, zeros=2)
    with pytest.raises(BadInput, match="one shape"):
        identify_recursively(record.command[:10], record.position, RATE_HZ)


def test_model_family__covariance__spreads_like_the_band() -> None:
    record = open_loop(PAPER, np.random.default_rng(24), 5.0, noise=1.0)
    model = identify(record, order=2).model
    members = model.family(200, np.random.default_rng(1))
    assert len(members) == 200
    levels = [20.0 * np.log10(abs(one.response(5.0) / model.response(np.array([5.0]))[0])) for one in members]
    assert 1.96 * np.std(levels) == pytest.approx(float(model.band_db(np.array([5.0]))[0]), rel=0.35)


def model(num: list[float], den: list[float]) -> PlantModel:
    free = len(num) + len(den) - 1
    return PlantModel(np.array(num), np.array(den), 0.0, np.eye(free + 1), band_hz=(0.2, 300.0))


def test_said__gain_that_a_pole_near_0_hz_evades__pole_is_named() -> None:
    free, slow = model([2740.0], [1.0, 97.0, 305.0]), 1e-6
    evading = model([2740.0, 3.0 * 305.0 * slow], np.polymul([1.0, 97.0, 305.0], [1.0, slow]).tolist())
    known = [FixedAgainstOwn(Fixed.parse("gain=3"), (9.0, 0.03))]
    off, apart = checks_against_own(known, evading, free)
    assert off.refuses
    assert off.value == pytest.approx(200.0)
    assert apart.where == "a pole at 1.6e-07 Hz evades a value at 0 Hz"
    assert not any("evades" in row.where for same in (free, evading) for row in checks_against_own(known, same, same))
