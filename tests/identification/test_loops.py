"""Records taken in a closed loop: what disturbs at the input, references of held levels, plants that only a loop holds.

The loop is stepped here sample by sample, with SciPy's hold of the plant.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from tactuator.identification.autoregressive import autoregressive_response
from tactuator.identification.data import response_of
from tactuator.identification.identify import identify
from tactuator.signals.record import Record
from witnesses.identification.feedback import judged

RATE_HZ = 2000.0
Array = NDArray[np.float64]
NUM, DEN = np.array([0.5 * (120.0 * np.pi) ** 2]), np.array([1.0, 72.0 * np.pi, (120.0 * np.pi) ** 2])


def looped(
    num: Array,
    den: Array,
    gains: tuple[float, float, float],
    *,
    seconds: float = 10.0,
    force: tuple[float, float] = (1.0, 0.0),
    noise_v: float = 1e-3,
    levels_v: float = 0.0,
    seed: int = 1,
) -> Record:
    """A record of a loop around num/den; gains: of position, integral and rate; force: corner (Hz) and volts of a slow
    force at the input; levels_v: of a held reference, beside a binary dither of 0.1 V."""
    rng, count = np.random.default_rng(seed), int(RATE_HZ * seconds)
    a, b, c, _, _ = signal.cont2discrete(signal.tf2ss(num, den), 1.0 / RATE_HZ, "zoh")
    slow = signal.lfilter([1.0], [1.0, -np.exp(-2.0 * np.pi * force[0] / RATE_HZ)], rng.standard_normal(count))
    slow *= force[1] / slow.std()
    dither = 0.1 * np.repeat(np.sign(rng.standard_normal(count // 8 + 1)), 8)[:count]
    target = levels_v * np.repeat(rng.uniform(-1.0, 1.0, count // 100 + 1), 100)[:count]
    noise = noise_v * rng.standard_normal(count)
    command, position = np.zeros(count), np.zeros(count)
    x, integral, before = np.zeros(den.size - 1), 0.0, 0.0
    for k in range(count):
        position[k] = c[0] @ x + noise[k]
        error = target[k] - position[k]
        integral += gains[1] * error / RATE_HZ
        command[k] = gains[0] * error + integral + gains[2] * (error - before) * RATE_HZ + dither[k]
        before = error
        x = a @ x + b[:, 0] * (command[k] + slow[k])
    return Record(RATE_HZ, command, position, reference=target + dither if den[-1] < 0.0 else None)


def off_db(found: object, num: Array, den: Array, hertz: Array) -> Array:
    s = 2j * np.pi * hertz
    return 20.0 * np.log10(np.abs(found.model.response(hertz) * np.polyval(den, s) / np.polyval(num, s)))  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "given",
    [
        pytest.param({"force": (6.4, 0.03)}, id="slow force"),
        pytest.param({"force": (0.6, 0.1), "seed": 7}, id="very slow force", marks=pytest.mark.slow),
        pytest.param({"noise_v": 0.02, "levels_v": 0.5}, id="held levels"),
    ],
)
def test_identify__loop_without_options__is_right_and_seen(given: dict[str, object]) -> None:
    record = looped(NUM, DEN, (1.5, 150.0, 0.0), **given)  # type: ignore[arg-type]
    found = identify(record)
    assert found.tests.feedback
    assert found.model.record["feedback"] == "likely: yes"
    assert ("feedback during the recording", "likely: yes", "") in found.tables()[0].rows
    assert found.holds or identify(record, closed_loop="yes").holds
    hertz = np.geomspace(1.0, 150.0, 60)
    assert np.all(np.abs(off_db(found, NUM, DEN, hertz)) <= found.model.band_db(hertz) + 0.1)
    assert np.all(np.roots(found.model.den).real < 0.0)


@pytest.mark.slow
def test_identify__plant_that_only_the_loop_holds__is_believed_with_a_reference() -> None:
    w = 2.0 * np.pi * 1.2
    num, den = np.array([w * w]), np.array([1.0, 0.0, -w * w])
    found = identify(looped(num, den, (3.0, 0.0, 0.15), seconds=20.0, noise_v=1e-4))
    assert np.sort(np.roots(found.model.den).real) == pytest.approx([-w, w], rel=0.02)
    assert found.holds


@pytest.mark.parametrize(
    ("seed", "verdict"),
    [
        pytest.param(13, "ok", id="slow force", marks=pytest.mark.slow),
        pytest.param(16, "ok", id="loop that leaves no trace"),
        pytest.param(119, "distrusted", id="dead time that the noise feigns"),
        pytest.param(2, "ok", id="quick growth", marks=pytest.mark.slow),
    ],
)
def test_identify__drawn_plant_that_only_the_loop_holds__band_holds_the_truth(seed: int, verdict: str) -> None:
    assert judged(seed, True)[:2] == (verdict, True)


@pytest.mark.parametrize("force", [(1.0, 0.0), (0.9, 0.1)], ids=["undisturbed", "slow force"])
def test_identify__plant_that_only_the_loop_holds__is_believed_without_one(force: tuple[float, float]) -> None:
    w = 2.0 * np.pi * 1.2
    num, den = np.array([w * w]), np.array([1.0, 0.0, -w * w])
    record = looped(num, den, (3.0, 0.0, 0.15), seconds=12.0, noise_v=1e-3, force=force, levels_v=0.3, seed=4)
    found = identify(replace(record, reference=None), friction=False)
    assert np.sort(np.roots(found.model.den).real) == pytest.approx([-w, w], rel=0.15)
    hertz = np.geomspace(*found.model.valid_hz, 60)
    assert np.all(np.abs(off_db(found, num, den, hertz)) <= found.model.band_db(hertz) + 0.1)
    assert (found.tests.feedback_is, found.holds) == ("likely: yes", True)


def test_identify__closed_loop_stated_no__begins_from_the_record_alone() -> None:
    record = looped(NUM, DEN, (1.5, 150.0, 0.0), force=(6.4, 0.03))
    found = identify(record, order=2, zeros=0, closed_loop="no", friction=False)
    assert found.tests.feedback is False
    assert found.model.record["feedback"] == "known: no"


def test_autoregressive_response__slow_force_in_a_loop__is_right_where_the_local_one_is_not() -> None:
    record = looped(NUM, DEN, (1.5, 150.0, 0.0), force=(6.4, 0.03))
    data = response_of([(record.command, record.position)], RATE_HZ)
    causal = autoregressive_response(data.spectra, data.local)
    assert causal is not None
    hertz = data.local.frequency_hz
    inside = (hertz > 3.0) & (hertz < 100.0)
    s = 2j * np.pi * hertz
    true = np.abs(np.polyval(NUM, s) / np.polyval(DEN, s))
    assert np.max(np.abs(20.0 * np.log10(np.abs(causal.value) / true))[inside]) < 1.0
    assert np.max(np.abs(20.0 * np.log10(np.abs(data.local.value) / true))[inside]) > 3.0
