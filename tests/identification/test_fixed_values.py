"""Fixed values: recovered, exact, told where they are wrong; and between which frequencies a model holds."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import optimize, signal

from tactuator.identification.by_response import identify_response
from tactuator.identification.check import ExcitationReport, check, valid_range
from tactuator.identification.identify import identify
from tactuator.identification.judge import judge
from tactuator.identification.options import Fixed, IdentifyOptions
from tactuator.identification.result import Identification
from tactuator.identification.trust import VALID
from tactuator.model.plant_model import Excess
from tactuator.signals.record import FrequencyResponse, Record
from tests.identification.others import Plant, band_limited, held
from tests.identification.plants import PAPER
from tests.identification.plants import RATE_HZ as SAMPLED_HZ

MASS, RESONANCE_HZ, Q, FILTER_HZ, RATE_HZ, DELAY_S, SECONDS = 0.02, 60.0, 4.0, 150.0, 600.0, 5e-4, 2.0
OMEGA = 2.0 * np.pi * RESONANCE_HZ
STIFFNESS, DAMPING = MASS * OMEGA**2, MASS * OMEGA / Q
PAIR = np.roots([MASS, DAMPING, STIFFNESS])
MOTION = Plant(np.array([]), PAIR, 1.0 / STIFFNESS, DELAY_S)
FILTERED = Plant(np.array([]), np.append(PAIR, -2.0 * np.pi * FILTER_HZ), 1.0 / STIFFNESS, DELAY_S)
HERTZ = np.geomspace(5.0, 180.0, 60)


HOLDS = {"held": "zero-order", "band-limited": "band-limited"}


@cache
def recorded(plant: Plant, kind: str, seed: int = 1) -> Record:
    make = {"held": held, "band-limited": band_limited}[kind]
    return Record(RATE_HZ, *make(plant, np.random.default_rng(seed), RATE_HZ, SECONDS, 40.0))


@cache
def found(plant: Plant, kind: str, *texts: str, order: int | None = None) -> Identification:
    fixed = tuple(map(Fixed.parse, texts))
    return identify(recorded(plant, kind), hold=HOLDS[kind], order=order, fixed=fixed)


def response(plant: Plant) -> FrequencyResponse:
    noise = np.random.default_rng(5).standard_normal((2, HERTZ.size))
    value = plant.response(HERTZ) * (1.0 + 0.003 * (noise[0] + 1j * noise[1]))
    return FrequencyResponse(HERTZ, np.abs(value), np.unwrap(np.angle(value)), np.full(HERTZ.size, 0.003))


BOTH = ("plant", "texts", "kind")
GAIN, POLE = f"gain={1.0 / STIFFNESS!r}", f"pole={FILTER_HZ}"


@pytest.mark.parametrize(
    BOTH,
    [
        (MOTION, [GAIN], "held"),
        (FILTERED, [POLE, GAIN], "band-limited"),
        pytest.param(FILTERED, [POLE], "held", marks=pytest.mark.slow),
    ],
)
def test_identify__values_of_the_truth__are_exact_and_the_band_no_wider(plant, texts, kind) -> None:
    free, bound = found(plant, kind), found(plant, kind, *texts)
    assert bound.order == plant.poles.size
    assert not bound.distrust
    assert bound.model.delay_s == pytest.approx(DELAY_S, abs=2e-5)
    for one in bound.fixed:
        own = one.fixed.of_model(bound.model)
        assert own[0] == pytest.approx(one.fixed.value, rel=1e-9)
        assert np.isnan(own[1]) or own[1] <= 1e-9 * abs(own[0])
    off = 20.0 * np.log10(np.abs(bound.model.response(HERTZ) / plant.response(HERTZ)))
    assert np.all(np.abs(off) <= np.maximum(bound.model.band_db(HERTZ), 0.01))
    # by noise the band is no wider anywhere; what forms the record does not exclude add to it is a matter of chance
    by_noise = [replace(one.model, excess=Excess.none()).band_db(HERTZ) for one in (bound, free)]
    assert np.all(by_noise[0] <= 1.02 * by_noise[1])
    assert np.all(bound.model.band_db(HERTZ) <= 1.3 * free.model.band_db(HERTZ))


@pytest.mark.parametrize(
    ("plant", "text", "kind"),
    [
        (MOTION, f"gain={0.8 / STIFFNESS!r}", "held"),
        pytest.param(FILTERED, "pole=100", "held", marks=pytest.mark.slow),
    ],
)
def test_identify__value_a_fifth_wrong__is_not_trusted_and_the_band_holds_the_truth(plant, text, kind) -> None:
    wrong = found(plant, kind, text)
    assert any("off the record's own" in reason for reason in wrong.distrust)
    off = 20.0 * np.log10(np.abs(wrong.model.response(HERTZ) / plant.response(HERTZ)))
    assert np.all(np.abs(off) <= wrong.model.band_db(HERTZ))


def test_identify__dead_time_fixed__stands_without_variance() -> None:
    made = found(MOTION, "held", f"delay_s={DELAY_S}")
    assert (made.model.delay_s, made.model.confidence()["delay_s"]) == (DELAY_S, 0.0)
    assert made.model.record["fixed"] == f"delay_s={DELAY_S}"
    assert not made.distrust


def test_identify_response__gain__the_rest_is_that_of_an_outside_optimiser() -> None:
    """Witness: scipy's least squares over mass, damping and dead time alone, weighted as the response says."""
    given = response(MOTION)
    made = identify_response(given, IdentifyOptions(order=2, zeros=0, fixed=(Fixed("gain", 1.0 / STIFFNESS),))).model
    value, s = given.value(), 2j * np.pi * HERTZ

    def left(theta: np.ndarray) -> np.ndarray:
        model = np.exp(-s * 1e-3 * theta[2]) / (MASS * theta[1] * s**2 + DAMPING * theta[0] * s + STIFFNESS)
        off = (model - value) / (0.003 * np.sqrt(2.0) * np.abs(value))
        return np.concatenate([off.real, off.imag])

    best = optimize.least_squares(left, [1.3, 1.1, 0.7], x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    assert made.num[0] * MASS == pytest.approx(1.0 / best[1], rel=1e-4)
    assert made.den[1] / made.num[0] / DAMPING == pytest.approx(best[0], rel=1e-4)
    assert made.delay_s == pytest.approx(1e-3 * best[2], rel=1e-4)


def test_identify_response__value_a_fifth_wrong__is_not_trusted() -> None:
    for plant, text in ((MOTION, f"gain={1.2 / STIFFNESS!r}"), (FILTERED, "pole=100")):
        made = identify_response(response(plant), IdentifyOptions(fixed=(Fixed.parse(text),)))
        assert any("off the record's own" in reason for reason in made.distrust), text


TOP_HZ, LATE = 60.0, 20


def simulated(command: np.ndarray) -> np.ndarray:
    num, den, _ = signal.cont2discrete((PAPER.num, PAPER.den), 1.0 / SAMPLED_HZ, "zoh")
    return np.asarray(signal.lfilter(num.ravel(), den, command))


@pytest.fixture(scope="module")
def record() -> Record:
    """The paper's plant, simulated by scipy, moved below 60 Hz alone."""
    rng = np.random.default_rng(5)
    source = rng.standard_normal(round(6.0 * SAMPLED_HZ))
    command = signal.sosfiltfilt(signal.butter(8, TOP_HZ, output="sos", fs=SAMPLED_HZ), source)
    position = simulated(command)
    noise = 1e-3 * position.std() * rng.standard_normal(position.size)
    return Record(SAMPLED_HZ, command, position + noise)


@pytest.fixture(scope="module", params=["refined", "rls"])
def found_by(record: Record, request: pytest.FixtureRequest) -> Identification:
    return identify(record, method=request.param, order=2)


def test_identify__command_without_power_above_a_frequency__claims_nothing_above(found_by: Identification) -> None:
    low, high = found_by.model.valid_hz
    assert low < 2.0
    assert 0.7 * TOP_HZ < high < 2.0 * TOP_HZ


def test_identify__record_s_own_response__is_in_the_model_s_units(found_by: Identification) -> None:
    """The figure draws both: in samples of unit size the dots stood decibels away from the curve."""
    shown = found_by.empirical.trusted(0.9)
    beside = shown.frequency_hz < 0.7 * TOP_HZ
    ratio = np.abs(shown.value / found_by.model.response(shown.frequency_hz))[beside]
    assert np.median(np.abs(np.log(ratio))) < 0.02


def test_judged__band_wide_everywhere__is_a_reason(record: Record) -> None:
    found_by = identify(record, method="rls", order=2)
    wide = replace(found_by.model, valid_hz=(1.0, 1.05))
    common = replace(check([record], IdentifyOptions()), excitation=ExcitationReport(9, 3, 1.0, 50.0))
    reasons = judge(replace(found_by, model=wide), common).distrust
    assert any(VALID.name in one for one in reasons)


def test_valid_range__band_narrow_nowhere__is_two_neighbours(record: Record) -> None:
    found_by = identify(record, method="rls", order=2)
    model = replace(found_by.model, covariance=1e12 * found_by.model.covariance)
    low, high = valid_range(model, (1.0, 60.0))
    assert low < high < 1.1 * low


def test_identify__least_squares_of_a_plant_with_dead_time__is_not_trusted() -> None:
    command = np.random.default_rng(8).standard_normal(6000)
    late = Record(SAMPLED_HZ, command[LATE:], simulated(command)[:-LATE])
    assert identify(late, method="rls", order=2).distrust
    prompt = Record(SAMPLED_HZ, command, simulated(command))
    assert not identify(prompt, method="rls", order=2).distrust
