"""Two hundred records of the outside generator; the same samples under another rate label or in other units."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.signals.record import Record
from tests.identification import others
from tests.identification.others import Plant, band_limited
from tests.identification.test_friction import rubbing_motor

SECONDS = {600.0: 40.0, 1000.0: 30.0, 4000.0: 20.0, 48000.0: 5.0}


def drawn(seed: int, draw: int, share: float) -> tuple[float, bool, bool, float, others.Plant, tuple[np.ndarray, ...]]:
    """Rate, filtered, closed, noise_db, plant and record: four rates, held and band-limited, open and closed loop."""
    rng = np.random.default_rng([14, seed] if draw == 1 else [14, seed, draw])
    rate_hz = list(SECONDS)[seed % 4]
    filtered, closed = (seed // 4) % 2 == 1, (seed // 8) % 2 == 1
    noise_db = rng.uniform(20.0, 60.0)
    plant = others.random_plant(rng, rate_hz)
    # in a loop every sample of a held record is a step of this generator
    seconds = 3.0 if closed and not filtered and rate_hz > 1e4 else SECONDS[rate_hz]
    make = others.band_limited if filtered else others.held
    made = make(plant, rng, rate_hz, share * seconds, noise_db, closed)
    return rate_hz, filtered, closed, noise_db, plant, made


def outcome(seed: int, share: float = 1.0) -> SimpleNamespace:
    """Of a seed's record (a draw whose loop runs away is replaced by the next; share: of its length): is the order
    right, which share of magnitude and phase is inside the band, how large are the errors where the model says
    something, what was said of hold and loop, and is it right."""
    draws = (drawn(seed, draw, share) for draw in range(1, 20))
    rate_hz, filtered, closed, noise_db, plant, made = next(
        one for one in draws if all(np.all(np.abs(signal) < 1e6) for signal in one[-1])
    )
    found = identify(Record(rate_hz, *made))
    hertz = np.geomspace(max(1.0, 3.0 * rate_hz / made[0].size), 0.3 * rate_hz, 300)
    off = np.log(found.model.response(hertz) / plant.response(hertz))
    band = found.model.band_db(hertz) / 8.686, found.model.band_rad(hertz)
    known = off[hertz <= found.model.valid_hz[1]]
    return SimpleNamespace(
        order_right=found.order == plant.poles.size,
        inside=(float(np.mean(np.abs(off.real) <= band[0])), float(np.mean(np.abs(off.imag) <= band[1]))),
        off_db=float(np.max(np.abs(known.real), initial=0.0)) * 8.686,
        off_deg=float(np.degrees(np.max(np.abs(known.imag), initial=0.0))),
        hold_told=found.between.certain,
        hold_right=(found.between.hold == "band-limited") == filtered,
        loop_right=found.tests.feedback in (closed, None),
        noise_db=noise_db,
    )


@pytest.mark.soak
def test_identify__two_hundred_outside_records__are_as_promised() -> None:
    made = [outcome(seed) for seed in range(200)]
    inside = np.array([one.inside for one in made])
    told = [one for one in made if one.hold_told]
    quiet = [one for one in told if one.noise_db >= 40.0]
    assert np.mean([one.order_right for one in made]) >= 0.95
    assert np.all(np.median(inside, axis=0) >= 0.9)
    assert np.all(np.quantile(inside, 0.1, axis=0) >= 0.8)
    assert max(one.off_db for one in quiet) <= 0.05
    assert max(one.off_deg for one in quiet) <= 1.0
    assert np.mean([one.hold_right for one in told]) >= 0.98
    assert all(one.loop_right for one in made)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 12, 88, 164])  # of each kind, held or filtered, open or closed, one
def test_identify__outside_record__is_as_promised(seed: int) -> None:
    one = outcome(seed, 0.4)
    assert one.order_right
    assert min(one.inside) > 0.6
    assert one.hold_right or not one.hold_told
    assert one.loop_right


PLANT = Plant(np.zeros(0), np.array([-42.65 + 435.0j, -42.65 - 435.0j]), 2.0, 1e-3)


FACTORS = [(1e3, 1e-3, 30.0), pytest.param(0.01, 250.0, 1e3, marks=pytest.mark.slow)]
"""Of the rate, of the command's unit and of the position's."""


@pytest.fixture(scope="module", params=["resonator", pytest.param("rubbing", marks=pytest.mark.slow)])
def known(request: pytest.FixtureRequest) -> tuple[Record, Identification]:
    """A record, of a motor that rubs or of a resonator, and what is identified of it as it is."""
    if request.param == "rubbing":
        record = Record(2500.0, *rubbing_motor(0.1, 5e-3, 2, 3.0))
    else:
        record = Record(610.35, *band_limited(PLANT, np.random.default_rng(7), 610.35, 4.0, 40.0))
    return record, identify(record)


@pytest.mark.parametrize(("faster", "command", "position"), FACTORS)
def test_identify__other_label_and_units__same_scaled_model(known, faster, command, position) -> None:
    record, was = known
    found = identify(Record(record.rate_hz * faster, command * record.command, position * record.position))
    assert (found.order, found.model.num.size) == (was.order, was.model.num.size)
    assert found.between.hold == was.between.hold
    frequency = np.array([5.0, 60.0, 150.0])
    same = was.model.response(frequency) * position / command
    np.testing.assert_allclose(found.model.response(frequency * faster), same, rtol=1e-3)
    assert found.model.delay_s * faster == pytest.approx(was.model.delay_s, rel=1e-2)
    if was.friction is not None:
        assert found.friction.coulomb == pytest.approx(command * was.friction.coulomb, rel=1e-6)
