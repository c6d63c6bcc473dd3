"""One table says what a model is trusted by; lost samples and two clocks are found and mended."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactuator.identification.constancy import losses, resampled, without_images
from tactuator.identification.trust import GROWING, STANDARDS
from tactuator.model.plant_model import reasons
from tactuator.signals.record import Record
from witnesses.trust.spoilt import RECORDS, judge, none

PAGE = Path(__file__).parents[2] / "docs" / "identification.md"
BY_NAME = {record.name: record for record in RECORDS}


def test_page__on_identification__has_the_table_as_the_code_has_it() -> None:
    page = PAGE.read_text()
    for standard in STANDARDS:
        assert f"| {standard.name} | {standard.of(0.0).allowed} | {standard.decides} |" in page


def test_weighed__beyond_its_limit__refuses_trust_and_says_both_numbers() -> None:
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


@pytest.mark.parametrize("noise_db", [60.0, 20.0, 0.0])
def test_losses__of_sound_records__are_none_however_noisy(noise_db: float) -> None:
    for record in (BY_NAME["16 samples lost"], BY_NAME["4 samples lost"], BY_NAME["2 samples lost, chirp"]):
        for seed in range(4):
            taken = replace(record, fault=none, noise_db=noise_db, seconds=5.0).make(seed)
            assert losses(taken.command, taken.position) == ()


def test_resampled__sine_of_another_clock__is_read_at_its_times() -> None:
    slow = np.sin(0.9 * np.arange(20_000) * (1.0 + 3e-4))
    read = resampled(slow, 300.0)
    np.testing.assert_allclose(read[100:-100], np.sin(0.9 * np.arange(read.size))[100:-100], atol=1e-4)


def test_without_images__held_sine__is_late_by_half_a_sample() -> None:
    """Witness: what a converter that holds a sine puts out at its frequency, sinc(f T), T/2 late."""
    turn, middle = 2.0 * np.pi * 0.1, np.arange(500, 19_500)
    command = np.sin(turn * np.arange(40_000))
    halved = without_images(Record(4000.0, command, command), held=True)
    seen = 2j * np.mean(halved.command[middle] * np.exp(-2j * turn * middle))
    assert np.log(seen) == pytest.approx(np.log(np.sinc(0.1)) - 0.5j * turn, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "status"),
    [("16 samples lost", 0), ("200 ppm back", 0), ("gain falls 20 %", 1), ("backlash", 0), ("amplifier clips", 1)],
)
def test_identify__spoilt_record__is_mended_or_not_trusted(name: str, status: int, tmp_path: Path) -> None:
    judged = judge(replace(BY_NAME[name], seconds=3.0), 7, tmp_path)
    assert (judged.verdict, judged.status) == ("ok", status)
