"""Periodic records: noise, even and odd distortion told apart, and the best linear approximation inside its band."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.identification.identify import identify
from tactuator.identification.result import Identification
from tactuator.report.device_figures import identification_figure
from tactuator.signals.multisine import Periods, odd_lines, periods_of
from tactuator.signals.record import Record

OVER = 20


@dataclass(frozen=True)
class Multisines:
    """Records of `realisations` multisines, each of `periods` periods; lines excited, equally loud."""

    rate_hz: float
    period: int
    periods: int
    realisations: int
    lines: np.ndarray

    def commands(self, records, rms, rng):
        spectrum = np.zeros((self.realisations, self.period // 2 + 1, records), dtype=complex)
        turn = rng.uniform(0.0, 2.0 * np.pi, (self.realisations, self.lines.size, records))
        spectrum[:, self.lines] = np.exp(1j * turn)
        made = np.fft.irfft(spectrum, self.period, axis=1)
        made *= rms / np.sqrt(np.mean(made**2, axis=1, keepdims=True))
        return np.concatenate([np.tile(one, (self.periods, 1)) for one in made])

    def about(self):
        return {
            "period_samples": str(self.period),
            "periods": str(self.periods),
            "realisations": str(self.realisations),
            "excited_lines": " ".join(str(k) for k in self.lines),
            "hold": "zero-order",
        }


def lines_of(rate_hz, period, band_hz, rng):
    """Odd lines between two frequencies, one of three left silent at random."""
    odd = np.arange(1, period // 2, 2)
    odd = odd[(odd * rate_hz / period >= band_hz[0]) & (odd * rate_hz / period <= band_hz[1])]
    groups = odd[: odd.size // 3 * 3].reshape(-1, 3)
    silent = rng.integers(0, 3, groups.shape[0])
    return np.sort(groups[np.arange(3)[None, :] != silent[:, None]])


def hardening(commands, rate_hz, size, damping, cubic, square=0.0):
    """Positions (samples, records) of x'' = size^2 (u - x - square x^2 - cubic x^3) - damping x', by Verlet's steps."""
    h = 1.0 / (rate_hz * OVER)
    place, speed = np.zeros(commands.shape[1]), np.zeros(commands.shape[1])
    positions = np.zeros(commands.shape)
    half, drag = 0.5 * h, 1.0 / (1.0 + 0.5 * h * damping)
    for k, command in enumerate(commands):
        positions[k] = place
        for _ in range(OVER):
            pull = size**2 * (command - place * (1.0 + place * (square + cubic * place)))
            middle = speed + half * (pull - damping * speed)
            place = place + h * middle
            pull = size**2 * (command - place * (1.0 + place * (square + cubic * place)))
            speed = drag * (middle + half * pull)
    return positions


RATE_HZ, PERIOD, RMS = 610.35, 256, 0.4
SIZE, DAMPING = 435.0, 85.0
LINES = lines_of(RATE_HZ, PERIOD, (2.0, 200.0), np.random.default_rng(1))
PLAN = Multisines(RATE_HZ, PERIOD, 3, 4, LINES)
HERTZ = LINES * RATE_HZ / PERIOD
CUBIC, SQUARE = np.array([0.0, 0.3, 0.3, 0.3, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, 0.06])
NOISE = 1e-3


def levels_of(plan: Multisines, commands: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, ...]:
    """Best linear approximation, its distortion at the excited lines, and that of odd and even silent lines."""
    u, y = (np.fft.rfft(one[plan.period :], axis=0) for one in (commands, positions))
    lines = plan.lines
    value = np.sum(y[lines] * np.conj(u[lines]), axis=1) / np.sum(np.abs(u[lines]) ** 2, axis=1)
    loud = np.mean(np.abs(u[lines]) ** 2)
    silent = np.setdiff1d(np.arange(lines[0], lines[-1]), lines)
    left = np.mean(np.abs(y[lines] - value[:, None] * u[lines]) ** 2, axis=1)
    odd, even = (np.mean(np.abs(y[silent[silent % 2 == part]]) ** 2, axis=1) for part in (1, 0))
    return value, np.sqrt(left / loud), np.sqrt(odd / loud), np.sqrt(even / loud)


@pytest.fixture(scope="module")
def found() -> list[Identification]:
    """Identifications of one linear, three hardening and one lopsided spring."""
    rng = np.random.default_rng(2)
    commands = PLAN.commands(CUBIC.size, RMS, rng)
    positions = hardening(commands, RATE_HZ, SIZE, DAMPING, CUBIC, SQUARE)
    positions += NOISE * rng.standard_normal(positions.shape)
    return [identify(Record(RATE_HZ, commands[:, k], positions[:, k], about=PLAN.about())) for k in range(CUBIC.size)]


@pytest.fixture(scope="module")
def truth() -> tuple[np.ndarray, ...]:
    one = Multisines(RATE_HZ, PERIOD, 2, 1, LINES)
    commands = one.commands(1000, RMS, np.random.default_rng(3))
    return levels_of(one, commands, hardening(commands, RATE_HZ, SIZE, DAMPING, 0.3))


def held_response(one: Identification) -> np.ndarray:
    """The model behind a converter that holds, by its impulse response: nothing of the package."""
    poles, gain = np.roots(one.model.den), one.model
    residues = np.array([np.polyval(gain.num, p) / np.polyval(np.polyder(gain.den), p) for p in poles])
    step = np.exp(2j * np.pi * HERTZ / RATE_HZ)[:, None]
    turned = np.exp(poles / RATE_HZ)
    return np.sum(residues / poles * (turned - 1.0) / (step - turned), axis=1)


def test_identify__linear_mechanism_under_multisines__shows_noise_alone(found: list[Identification]) -> None:
    one = found[0]
    assert not one.distortion.shows
    assert (one.order, one.model.num.size, one.tests.feedback) == (2, 1, False)
    # the mean of two periods; a line's power beside that of all samples
    expected = NOISE / np.sqrt(2.0 * PERIOD) / (RMS / np.sqrt(2.0 * LINES.size))
    assert np.median(one.distortion.noise) == pytest.approx(expected, rel=0.15)
    np.testing.assert_allclose(one.model.den, [1.0, DAMPING, SIZE**2], rtol=0.01)


def test_identify__hardening_spring__levels_are_right_and_the_band_holds(found, truth) -> None:
    value, distortion, odd, _ = truth
    inside = []
    for one in found[1:4]:
        seen = one.distortion
        assert seen.shows
        assert abs(np.median(20.0 * np.log10(seen.distortion / distortion))) < 3.0
        assert abs(20.0 * np.log10(np.median(seen.odd) / np.median(odd))) < 3.0
        assert np.all(seen.even[np.isfinite(seen.even)] < 0.3 * np.median(odd))
        off = np.log(held_response(one) * np.exp(-2j * np.pi * HERTZ * one.model.delay_s) / value)
        inside += [np.abs(off.real) * 8.686 <= one.model.band_db(HERTZ), np.abs(off.imag) <= one.model.band_rad(HERTZ)]
    assert np.mean(inside) > 0.85


def test_identify__lopsided_spring__shows_on_even_lines(found: list[Identification]) -> None:
    seen = found[4].distortion
    assert seen.shows
    assert np.median(seen.even) > 3.0 * np.median(seen.noise)
    assert np.median(seen.even) > 3.0 * np.median(seen.odd)


def test_identify__distortion__widens_the_band_and_is_drawn(found: list[Identification]) -> None:
    assert found[1].model.band_db(HERTZ).min() > 3.0 * found[0].model.band_db(HERTZ).min()
    (legend,) = identification_figure(found[1]).drawing.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert {"model, with its 95 % band", "noise", "noise and distortion", "distortion, odd lines"} <= set(labels)


def test_periods__attributes__are_read_back() -> None:
    plan = Periods(256, 3, 4, LINES)
    about = plan.attributes() | {"rig": "simulated"}
    read = periods_of(about, plan.samples)
    assert (read.period, read.repeats, read.realisations) == (256, 3, 4)
    np.testing.assert_array_equal(read.lines, LINES)
    assert periods_of({"rig": "simulated"}, 10) is None
    with pytest.raises(BadInput, match="its periods need 3072"):
        periods_of(about, 3071)
    with pytest.raises(BadInput, match="whole numbers"):
        periods_of(about | {"periods": "many"}, plan.samples)
    whole = Record(100.0, np.arange(3072.0), np.arange(3072.0), about=about)
    assert periods_of(whole.part(slice(100, None)).about, 2972) is None


@pytest.mark.parametrize("change", [{"period": 4}, {"repeats": 1}, {"lines": np.array([3, 2])}, {"lines": LINES + 200}])
def test_periods__that_cannot_be__are_refused(change: dict) -> None:
    with pytest.raises(BadInput, match="; "):
        replace(Periods(256, 3, 4, LINES), **change)


def test_odd_lines__are_odd_off_mains_and_leave_odd_ones_silent() -> None:
    lines = odd_lines((0.4, 300.0), 4000.0, 20000, 160, np.random.default_rng(0))
    assert np.all(lines % 2 == 1)
    hertz = lines * 0.2
    assert np.all(np.abs(hertz - 60.0 * np.round(hertz / 60.0)) > 0.25)
    odd, even = Periods(20000, 3, 4, lines).silent(4000.0)
    assert odd.size > 20
    assert even.size > 100
    with pytest.raises(BadInput, match="8 or more"):
        odd_lines((0.4, 300.0), 4000.0, 100, 160, np.random.default_rng(0))
