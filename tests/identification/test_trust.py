"""What a model is trusted by: lost samples, clocks, the best of several fits, residuals and what they tell of the hold.

What SciPy has too, beside it: filters of residuals to the last bit, tails, filters of loops, fast lengths.
"""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg, signal

from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.identification import trust
from tactuator.identification.alignment import clock_skew_ppm, losses
from tactuator.identification.form import Form, Known
from tactuator.identification.friction import _REACH, _uphill
from tactuator.identification.hold import Grid
from tactuator.identification.identify import identify
from tactuator.identification.likelihood import SpectralProblem
from tactuator.identification.lines import points, spectrum
from tactuator.identification.residual import Residual, _solutions, explained_by_loop
from tactuator.identification.residual_tests import check_residual
from tactuator.identification.search import Choice, _best, simplest
from tactuator.identification.trust import DISTORTION, GROWING, LASTING, Standard
from tactuator.io.record import write_record
from tactuator.model.plant_model import reasons
from tactuator.signals.record import Record
from tests.identification.others import Plant, band_limited, held
from witnesses.trust.spoilt import RATE_HZ as SPOILT_HZ
from witnesses.trust.spoilt import RECORDS, judge, none, skew

PAGE = Path(__file__).parents[2] / "docs" / "identification.md"
BY_NAME = {record.name: record for record in RECORDS}


def test_page__on_identification__has_the_tables_as_the_code_has_them() -> None:
    tables = dict(re.findall(r"^\| ([\w ]+) \| limit \|\n(.*?)\n\n", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL))
    standards = [each for each in vars(trust).values() if isinstance(each, Standard)]
    shown = [f"| {each.name} | {each.of(0.0).allowed} |" in tables[each.decides].splitlines() for each in standards]
    assert sum(shown) == len(shown) > 20


def test_quality_check__beyond_its_limit__refuses_trust_and_says_both_numbers() -> None:
    assert reasons([GROWING.of(0.0)]) == ()
    (reason,) = reasons([GROWING.of(0.0), GROWING.of(2.0, "here")])
    assert reason == f"{GROWING.name}, here: 2 (at most 0)"


@pytest.mark.parametrize("lost", [3, 40, -25])
def test_losses__of_one_column__are_placed_to_a_few_samples(lost: int) -> None:
    """Witness: a resonance by numpy's convolution, white noise, one block taken out."""
    rng, at = np.random.default_rng(abs(lost)), 21_000
    command, t = rng.standard_normal(40_000), np.arange(400)
    position = np.convolve(command, np.exp(-t / 40.0) * np.sin(0.3 * t))[: command.size]
    position += 0.01 * position.std() * rng.standard_normal(position.size)
    gone = np.arange(at, at + abs(lost))
    columns = (command, np.delete(position, gone)) if lost > 0 else (np.delete(command, gone), position)
    count = min(column.size for column in columns)
    (loss,) = losses(*(column[:count] for column in columns))
    assert loss.lost == lost
    assert abs(loss.sample - at) <= 30
    assert losses(command, position) == ()


def test_losses__slow_motion_above_the_excitation__none_where_none_is_and_one_where_one_is() -> None:
    """Witness: a sluggish motor by SciPy, whose position wanders slowly by more than it answers."""
    rng = np.random.default_rng(5)
    band = signal.butter(4, [20.0, 400.0], "bandpass", fs=4000.0, output="sos")
    command = signal.sosfilt(band, rng.standard_normal(80_000))
    answer = signal.sosfilt(signal.butter(2, 8.0, fs=4000.0, output="sos"), command)
    wander = signal.sosfilt(signal.butter(2, 1.0, fs=4000.0, output="sos"), rng.standard_normal(80_000))
    position = answer + 3.0 * answer.std() / wander.std() * wander
    assert losses(command, position) == ()
    (loss,) = losses(command[:-12], np.delete(position, np.arange(30_000, 30_012)))
    assert (loss.lost, abs(loss.sample - 30_000) < 200) == (12, True)


def test_identify__lost_samples__are_told_with_their_place_and_the_cut_that_helps(tmp_path, capsys) -> None:
    taken = replace(BY_NAME["64 samples lost"], seconds=4.0).make(3)
    record = Record(SPOILT_HZ, taken.command, taken.position)
    told = r"about 64 of the position at 2\.8\d* s; expected what lies before \(`to_s` 2\.7\d*\)"
    for whole in (record, record.between(0.5, 3.9)):  # of a part the place is told in the whole
        with pytest.raises(BadInput, match=told):
            identify(whole)
    write_record(tmp_path / "lost.h5", record)
    out = tmp_path / "model.json"
    arguments = ["identify", str(tmp_path / "lost.h5"), "--hold", "zero-order", "--out", str(out)]
    assert (main(arguments), out.exists()) == (2, False)
    assert re.search(told.replace("`to_s`", "--to-s"), capsys.readouterr().err)
    assert (main([*arguments, "--to-s", "2.7"]), out.exists()) == (0, True)


@pytest.mark.parametrize("noise_db", [60.0, 20.0, 0.0])
def test_losses__of_sound_records__are_none_however_noisy(noise_db: float) -> None:
    for record in (BY_NAME["16 samples lost"], BY_NAME["4 samples lost"], BY_NAME["2 samples lost, chirp"]):
        for seed in range(4):
            taken = replace(record, fault=none, noise_db=noise_db, seconds=5.0).make(seed)
            assert losses(taken.command, taken.position) == ()


@pytest.mark.parametrize("ppm", [200.0, -200.0])
def test_clock_skew__position_of_another_clock__is_told(ppm: float) -> None:
    taken = replace(BY_NAME["200 ppm"], fault=skew(ppm), seconds=8.0).make(1)
    assert clock_skew_ppm(Record(SPOILT_HZ, taken.command, taken.position)) == pytest.approx(200.0, rel=0.1)
    assert losses(taken.command, taken.position) == ()


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("16 samples lost", 2),
        pytest.param("200 ppm back", 1, marks=pytest.mark.slow),
        ("gain falls 20 %", 1),
        ("backlash", 0),
        ("amplifier clips", 1),
        pytest.param("every 4th sample, white", 1, marks=pytest.mark.slow),
        ("cubic sensor", 1),
    ],
)
def test_identify__spoilt_record__is_refused_or_not_trusted(name, status, tmp_path) -> None:
    # every fourth sample of three seconds is a record of so few that the search takes twice as long
    judged = judge(replace(BY_NAME[name], seconds=6.0 if name.startswith("every") else 3.0), 7, tmp_path)
    assert (judged.verdict, judged.status) == ("ok", status)


def test_identify__short_sweep_of_one_clock__is_trusted() -> None:
    """The generator is SciPy's. A resonance's delay changes with frequency, as two clocks change it with time."""
    rate_hz, turn, seconds = 2000.0, 2.0 * np.pi * 45.0, 5.0
    t = np.arange(int(seconds * rate_hz)) / rate_hz
    command = signal.chirp(t, 2.0, seconds, 400.0, method="logarithmic")
    b, a, _ = signal.cont2discrete(([turn**2], [1.0, 0.5 * turn, turn**2]), 1.0 / rate_hz, method="zoh")
    position = signal.lfilter(b[0], a, command) + 1e-3 * np.random.default_rng(1).standard_normal(t.size)
    fit = identify(Record(rate_hz, command, position), order=2, zeros=0, hold="zero-order", friction=False)
    assert fit.model.distrust == fit.remarks == ()
    np.testing.assert_allclose(fit.model.den, [1.0, 0.5 * turn, turn**2], rtol=2e-3)


@pytest.mark.parametrize(("hardening", "status"), [(0.0, 0), (0.5, 1)])
def test_identify__spring_that_hardens__is_not_trusted(hardening: float, status: int) -> None:
    """The generator is a Verlet integration, 8 steps in a sample."""
    rng, rate_hz, turn = np.random.default_rng(7), 1000.0, 2.0 * np.pi * 45.0
    command = signal.lfilter(*signal.butter(2, 0.3), rng.standard_normal(6000))
    step, place, before, position = 1.0 / (8.0 * rate_hz), 0.0, 0.0, np.empty(command.size)
    for k, force in enumerate(command.tolist()):
        position[k] = place
        for _ in range(8):
            speed = (place - before) / step
            push = turn**2 * (force - place - hardening * place**3) - 0.5 * turn * speed
            place, before = 2.0 * place - before + step**2 * push, place
    position += 1e-3 * rng.standard_normal(command.size)
    fit = identify(Record(rate_hz, command, position), hold="zero-order", friction=False)
    assert int(bool(fit.model.distrust)) == status
    assert any(reason.startswith(DISTORTION.name) for reason in fit.model.distrust) == bool(status)


@pytest.mark.parametrize(("decay_s", "why"), [(0.5, ()), (50.0, (f"{LASTING.name}: 1 (at most 0)",))])
def test_identify__resonance__is_trusted_where_it_dies_out_within_the_record(decay_s: float, why: tuple) -> None:
    """The generator is SciPy's, zero-order hold."""
    rng, turn = np.random.default_rng(3), 2.0 * np.pi * 40.0
    b, a, _ = signal.cont2discrete(([turn**2], [1.0, 2.0 / decay_s, turn**2 + decay_s**-2]), 1e-3, method="zoh")
    command = rng.standard_normal(5000)
    position = signal.lfilter(b[0], a, command)
    position += 1e-3 * position.std() * rng.standard_normal(command.size)
    assert identify(Record(1000.0, command, position), friction=False).model.distrust == why


def test_best__whatever_the_costs__is_one_of_them():
    """Found with a threefold integrator: beside a cost of 1e17 a tie's width is nothing."""
    problem = SpectralProblem(SimpleNamespace(total=1000), np.ones(1), None)
    nan, inf = np.nan, np.inf
    for costs, best in (((100.0, 50.0), 3), ((nan, 1e5), 3), ((1e5, nan), 2), ((1e20, 1e20), 2), ((inf, nan), 2)):
        forms = [SimpleNamespace(poles=n, count=n) for n in (2, 3)]
        fits = [SimpleNamespace(cost=cost, form=form) for cost, form in zip(costs, forms, strict=True)]
        assert _best(problem, dict(enumerate(fits))).form.poles == best


def through_a_card(plant: Plant, top_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return command and position at 16 kHz without noise, band-limited, at rest at both ends, in single precision."""
    rate_hz, count = 16000.0, 32000
    rng = np.random.default_rng(1)
    lines, place = np.fft.rfft(rng.standard_normal(count)), np.fft.rfftfreq(count, 1.0 / rate_hz)
    burst = np.fft.irfft(np.where((place > 2.0) & (place < top_hz), lines, 0.0), count) * np.sqrt(np.hanning(count))
    command = np.concatenate([np.zeros(700), burst, np.zeros(count)])
    answer = plant.response(np.fft.rfftfreq(command.size, 1.0 / rate_hz))
    position = np.fft.irfft(np.fft.rfft(command) * answer, command.size)
    return tuple(one[: count + 8000].astype(np.float32).astype(np.float64) for one in (command, position))


@pytest.mark.parametrize(
    ("top_hz", "delay_s", "hertz", "q"),
    [(2000.0, 0.0, 60.0, 2.0), (5e3, 2.88e-3, 102.0, 19.0), (5e3, 2.88e-3, 60.0, 2.0)],
)
def test_identify__noise_free_through_a_card__simplest_form_and_trusted(top_hz, delay_s, hertz, q) -> None:
    """Each was refused for a pole at millions of hertz, or one in the right half plane with a zero on it."""
    pole = 2.0 * np.pi * hertz * (1.0j - 0.5 / q)
    plant = Plant(np.zeros(0), np.array([pole, np.conj(pole)]), 2.0, delay_s)
    found = identify(Record(16000.0, *through_a_card(plant, top_hz)), hold="band-limited")
    assert (found.order, found.model.num.size - 1) == (2, 0)
    assert not found.distrust
    place = np.geomspace(*found.model.valid_hz, 200)
    assert np.max(np.abs(20.0 * np.log10(np.abs(found.model.response(place) / plant.response(place))))) < 1e-5


@pytest.mark.slow
def test_simplest__what_stands_out_of_the_band__is_kept() -> None:
    pole, weak = -80.0 + 900.0j, -15.0 + 1500.0j
    zero = 1.01 * weak
    poles, zeros = ([*pair, *np.conj(pair)] for pair in ((pole, weak), (zero,)))
    plant = Plant(np.array(zeros), np.array(poles), 1.0, 0.0)
    found = identify(Record(2000.0, *band_limited(plant, np.random.default_rng(2), 2000.0, 8.0, 50.0)), friction=False)
    assert (found.order, found.model.num.size - 1) == (4, 2)
    place = np.geomspace(1.0, 600.0, 100)
    assert np.max(np.abs(20.0 * np.log10(np.abs(found.model.response(place) / plant.response(place))))) < 0.2


def test_simplest__simpler_form_that_leaves_less__is_taken() -> None:
    """A record of a levitated magnet had six poles and a seventh at 1e17 Hz: without that one, they fitted better."""
    place = np.geomspace(1.0, 300.0, 60)
    s = 2j * np.pi * place / 100.0
    grid, answer = Grid(place, 2000.0, 100.0, "band-limited"), 3.0 / (s * s + 2.0 * s + 5.0)
    problem = SpectralProblem(points(place, answer, 2000.0), 1e3 / np.abs(answer), grid, with_transient=False)
    fit = problem.descend(Form(3, 0), np.array([2.5, 6.0, -1e9]), 0.0, most=0)
    chosen, missed = simplest(Choice("band-limited", fit, {fit.form: fit}, problem), Known(), lambda _: False)
    assert (missed, chosen.fit.form) == (True, Form(2, 0))
    np.testing.assert_allclose(chosen.fit.theta, [2.0, 5.0], rtol=1e-6)


RATE_HZ, COUNT = 1000.0, 8000


def residual_of(command: np.ndarray, residual: np.ndarray) -> Residual:
    taken = spectrum(command, residual, RATE_HZ)
    ones = np.ones(taken.position.size)
    return Residual(taken.position, ones, ones[1:] + 0j, taken)


def noises(seed: int) -> tuple[np.ndarray, np.ndarray]:
    first, second = np.random.default_rng(seed).standard_normal((2, COUNT))
    return signal.lfilter([1.0], [1.0, -0.9], first), second


def test_explained_by_loop__command_apart_or_ahead_of_the_residual__is_nothing() -> None:
    for seed in range(5):
        own, noise = noises(seed)
        ahead = signal.lfilter([1.0, -0.9], [1.0], own) + np.roll(noise, -20)
        for command in (own, ahead):
            assert explained_by_loop(residual_of(command, noise), 470.0, filtered=True) == 0.0


def test_explained_by_loop__command_that_follows__is_its_regressions_likelihood() -> None:
    own, noise = noises(6)
    # white innovations, so that the regression's sum of squares is the likelihood
    white = signal.lfilter([1.0, -0.9], [1.0], own)
    command = white - 0.5 * noise - 0.25 * np.roll(noise, 1)
    found = explained_by_loop(residual_of(command, noise), 500.0, filtered=False)
    expected = COUNT * np.log(np.var(command) / np.var(white)) - 2.0 * np.log(COUNT)
    assert found == pytest.approx(expected, rel=0.05)


def test_identify__held_loop_with_noise__is_told_or_left_open() -> None:
    """The command answers the noise within its sample: read as band-limited the position alone is likelier."""
    plant = Plant(np.zeros(0), np.array([-315.0 + 774.0j, -315.0 - 774.0j, -650.0]), 0.6, 0.0)
    record = Record(600.0, *held(plant, np.random.default_rng(13), 600.0, 10.0, 22.0, closed=True))
    found = identify(record, order=3)
    assert found.between.hold == "zero-order"
    frequency = np.geomspace(1.0, 180.0, 100)
    off = np.log(found.model.response(frequency) / plant.response(frequency))
    assert np.mean(np.abs(off.imag) <= found.model.band_rad(frequency)) > 0.9


def test_solutions__every_length__are_scipys_of_toeplitz_equations() -> None:
    row, goal = 0.8 ** np.arange(43.0) * np.cos(np.arange(43)), np.random.default_rng(0).standard_normal(43)
    lengths = [
        np.testing.assert_allclose(taps, linalg.solve_toeplitz(row[: taps.size], goal[: taps.size]), atol=1e-12)
        for taps in _solutions(row, goal)
    ]
    assert len(lengths) == 43


@pytest.mark.parametrize("step", [1, 8])
def test_uphill__one_summit_within_reach__is_found_in_few_trials(step: int) -> None:
    for summit in range(-_REACH, _REACH + 1):
        tried, off = set[int](), [abs(place - summit) for place in range(-_REACH, _REACH + 1)]
        found = _uphill(lambda *at, off=off, now=tried: now.update(at) or min(at, key=lambda k: off[k + _REACH]), step)
        assert found == summit
        assert len(tried) <= 12


@pytest.mark.parametrize("amiss", [np.inf, np.nan, 1e200])
def test_residual__slopes_that_overflow__speak_for_no_model(amiss):
    """Found with a record of a plant that runs away: the eigenvalues of what was no number did not converge."""
    random = np.random.default_rng(1)
    slopes = random.standard_normal((4000, 2))
    slopes[17, 1] = amiss
    with np.errstate(all="ignore"):
        found = check_residual(random.standard_normal(4000), random.standard_normal(4000), slopes, 1000.0)
    assert found.uncorrelated_p == 0.0
