"""The best of several fits, where costs are large, or no numbers; the simplest of those that cannot be told apart."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactuator.identification.form import Form, Known
from tactuator.identification.hold import Grid
from tactuator.identification.identify import identify
from tactuator.identification.likelihood import SpectralProblem
from tactuator.identification.lines import points
from tactuator.identification.search import Choice, _best, simplest
from tactuator.signals.record import Record
from tests.identification.others import Plant, band_limited


def test_best__whatever_the_costs__is_one_of_them():
    """Found with a threefold integrator: beside a cost of 1e17 a tie's width is nothing."""
    problem = SimpleNamespace(given=SimpleNamespace(total=1000))
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


def test_simplest__what_stands_out_of_the_band__is_kept() -> None:
    pole, weak = -80.0 + 900.0j, -15.0 + 1500.0j
    zero = 1.01 * weak
    poles, zeros = ([*pair, *np.conj(pair)] for pair in ((pole, weak), (zero,)))
    plant = Plant(np.array(zeros), np.array(poles), 1.0, 0.0)
    found = identify(Record(2000.0, *band_limited(plant, np.random.default_rng(2), 2000.0, 8.0, 50.0)), friction=False)
    assert (found.order, found.model.num.size - 1) == (4, 2)
    place = np.geomspace(1.0, 600.0, 100)
    assert np.max(np.abs(20.0 * np.log10(np.abs(found.model.response(place) / plant.response(place))))) < 0.2


def test_simplest__simpler_form_that_leaves_less__is_taken_though_it_can_be_told_apart() -> None:
    """A record of a levitated magnet had six poles and a seventh at 1e17 Hz: without that one, they fitted better."""
    place = np.geomspace(1.0, 300.0, 60)
    s = 2j * np.pi * place / 100.0
    grid, answer = Grid(place, 2000.0, 100.0, "band-limited"), 3.0 / (s * s + 2.0 * s + 5.0)
    problem = SpectralProblem(points(place, answer, 2000.0), 1e3 / np.abs(answer), grid, with_transient=False)
    fit = problem.descend(Form(3, 0), np.array([2.5, 6.0, -1e9]), 0.0, most=0)
    chosen, missed = simplest(Choice("band-limited", fit, {fit.form: fit}, problem), Known(), lambda _: False)
    assert (missed, chosen.fit.form) == (True, Form(2, 0))
    np.testing.assert_allclose(chosen.fit.theta, [2.0, 5.0], rtol=1e-6)
