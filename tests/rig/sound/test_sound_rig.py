"""The rig on a sound card whose time is turned by hand: rows, alignment, gaps, limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from tactuator.errors import BadInput, DeviceFault
from tactuator.model.controller import Limits, StrengthShaping
from tactuator.rig.rig import Rig, join_traces
from tactuator.rig.sound.cards import full_scale_v, measure_delay, tone, wire_display
from tactuator.rig.sound.rig import TRIES, SoundRig
from tactuator.rig.sound.stream import CardGone, CardRows, SoundGap
from tests.rig.sound.turned_card import (
    OVERFLOW,
    PERIOD,
    RATE_HZ,
    TurnedCard,
    flat_controller,
    sound_display,
    turned_rig,
)


def wire_rig(**card) -> SoundRig:
    rows = CardRows(1, 1, 16384, RATE_HZ)
    turned = TurnedCard(rows, **{"delay": PERIOD} | card)
    return SoundRig(wire_display(RATE_HZ, 1, 1), rows, turned, turned.sleep)


@pytest.mark.parametrize("delay", [PERIOD, 777])
def test_measure_delay__wire__within_no_sample(delay: int):
    noise = np.random.default_rng(3)

    def answer(out: np.ndarray) -> np.ndarray:
        return (-0.5 * out + 0.01 * noise.standard_normal(out.shape)).astype(np.float32)

    found = measure_delay(wire_rig(delay=delay, answer=answer), 0.3, np.random.default_rng(1))
    assert (found.samples, found.spread) == (delay, 0)
    assert found.gain == pytest.approx(-0.5, abs=0.01)


def test_tone__through_a_wire_of_known_gain__its_peak_and_volts():
    heard = tone(wire_rig(answer=lambda out: (0.25 * out).astype(np.float32)), 100.0, 0.4, 2.0)
    assert heard == pytest.approx(0.1, rel=1e-3)
    assert full_scale_v(1.0, 0.4) == pytest.approx(3.5355, rel=1e-4)


@pytest.mark.parametrize("heard", ["nothing", "noise", "hum"])
def test_delay_and_tone__no_wire__are_refused(heard: str):
    noise, rows = np.random.default_rng(3), [0]

    def answer(out: np.ndarray) -> np.ndarray:
        time = (rows[0] + np.arange(len(out))) / RATE_HZ
        rows[0] += len(out)
        hum = 0.01 * np.sin(2.0 * np.pi * 50.0 * time)[:, None] * (heard == "hum")
        return (hum + 0.01 * (heard == "noise") * noise.standard_normal(out.shape)).astype(np.float32)

    with pytest.raises(BadInput, match="does not come back at the input"):
        tone(wire_rig(answer=answer), 100.0, 0.4, 2.0)
    with pytest.raises(BadInput, match="does not come back at the input"):
        measure_delay(wire_rig(answer=answer), 0.3, np.random.default_rng(1))


def test_tone_and_full_scale__out_of_range__are_refused():
    for level, frequency in ((0.0, 100.0), (1.0, 100.0), (0.1, 4000.0)):
        with pytest.raises(BadInput, match="1 to 3200 Hz"):
            tone(wire_rig(), frequency, level, 1.0)
    with pytest.raises(BadInput, match="a reading of 0 V rms"):
        full_scale_v(0.0, 0.1)


def commands(count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2))


def test_drive__outputs_wired_to_inputs__every_bit_comes_back_in_its_place():
    rig, _ = turned_rig(sound_display(latency_samples=PERIOD))
    trace = rig.drive(commands(3000))
    soft = round(0.02 * RATE_HZ)
    assert np.array_equal(trace.command_v[soft:], commands(3000)[soft:])
    assert np.array_equal(trace.position_v, 4.0 * (trace.command_v / 2.0).astype(np.float32))
    assert np.max(np.abs(trace.command_v[: soft // 4])) < 0.16


def test_drive__latency_not_said__inputs_come_later_by_it():
    rig, _ = turned_rig(sound_display(), delay=PERIOD + 7)
    assert isinstance(rig, Rig)
    assert rig.began_at is None
    trace = rig.drive(commands(2000))
    assert rig.began_at is not None
    late = PERIOD + 7
    assert not np.any(trace.position_v[:late])
    assert np.array_equal(trace.position_v[late:, 1], 4.0 * (trace.command_v[:-late, 1] / 2.0).astype(np.float32))


def test_drive__wires_crossed_in_the_file__channels_go_where_it_says():
    display = sound_display(latency_samples=PERIOD)
    crossed = replace(display.sound, wires=display.sound.wires[::-1])
    rig, card = turned_rig(replace(display, sound=crossed))
    trace = rig.drive(commands(500) * [1.0, 0.0])
    assert list(np.any(np.concatenate(card.put_out), axis=0)) == [False, True]
    assert list(np.any(trace.position_v, axis=0)) == [True, False]


def test_stream__cut_into_blocks__same_trace_as_one_block():
    display = sound_display(latency_samples=PERIOD)
    reference = 5.0 * commands(6000)
    traces = []
    for cuts in ([], [1, 2, 700, 5999], list(range(100, 6000, 100))):
        rig, _ = turned_rig(display)
        rig.load(flat_controller(display))
        blocks = np.split(reference, cuts)
        parts = list(rig.stream(blocks))
        traces.append(join_traces(parts, rig.rate_hz, rig.channels))
        assert rig.rows_played == 6000
    assert all(traces[0].equals(other) for other in traces[1:])
    assert np.array_equal(traces[0].reference, reference)


def test_command__prefilter_of_sections__what_scipy_computes_of_the_whole():
    display = sound_display(latency_samples=PERIOD)
    sos = signal.butter(4, 200.0, fs=RATE_HZ, output="sos") * [[0.01, 0.01, 0.01, 1, 1, 1], [1] * 6]
    rig, _ = turned_rig(display)
    rig.load(flat_controller(display, prefilter_sos=sos))
    reference = 5.0 * commands(4000)
    command = np.concatenate([one.command_v for one in rig.stream(np.split(reference, [123, 456, 3000]))])
    assert np.allclose(command, signal.sosfilt(sos, reference, axis=0), rtol=0, atol=1e-12)


def test_output__after_the_reference__rings_out_and_is_at_rest():
    display = sound_display()
    sos = signal.butter(2, 30.0, fs=RATE_HZ, output="sos") * [[0.05, 0.05, 0.05, 1, 1, 1]]
    rig, card = turned_rig(display)
    rig.load(flat_controller(display, prefilter_sos=sos))
    rig.play(np.full((800, 2), 5.0))
    rig.rest()
    out = np.concatenate(card.put_out)[:, 0].astype(float)
    assert out[-1] == 0.0
    assert np.max(np.abs(np.diff(out))) < 1.1 * np.max(np.abs(np.diff(signal.sosfilt(sos, np.full(800, 2.5)))))


@pytest.mark.parametrize("times", [1, TRIES - 1])
def test_drive__gaps_told_by_the_card__is_repeated_and_every_gap_counted(times: int):
    told = []

    def flags(call: int) -> int:
        if len(told) < times and call % 40 == 39:
            told.append(call)
            return OVERFLOW
        return 0

    rig, _ = turned_rig(sound_display(latency_samples=PERIOD), flags=flags)
    trace = rig.drive(commands(3000))
    assert len(told) == rig.gaps == times
    assert np.array_equal(trace.position_v, 4.0 * (trace.command_v / 2.0).astype(np.float32))


def test_drive__a_gap_every_time__is_refused():
    rig, _ = turned_rig(sound_display(), flags=lambda call: OVERFLOW)
    with pytest.raises(SoundGap, match="reported a gap"):
        rig.drive(commands(3000))
    assert rig.gaps >= TRIES


def test_stream__gaps_allowed__all_are_counted():
    display = sound_display()
    rig, _ = turned_rig(display, flags=lambda call: OVERFLOW if call % 20 == 5 else 0)
    rig.load(flat_controller(display))
    rig.allow_gaps = True
    calls = 128 * 100 // PERIOD
    list(rig.stream([np.zeros((128, 2))] * 100))
    assert calls // 20 - 1 <= rig.gaps <= calls // 20 + 4


@pytest.mark.parametrize(
    ("stops_at", "words", "silent_s"), [(20, "has stopped", 1.0), (1, "not a sample for 5 s", 5.0)]
)
def test_drive__card_unplugged_or_never_started__ends_in_a_device_fault_and_closes(stops_at, words, silent_s):
    rig, card = turned_rig(sound_display(), stops_at=stops_at)
    with pytest.raises(CardGone, match=words) as told:
        rig.drive(commands(20000))
    assert isinstance(told.value, DeviceFault)
    assert silent_s < card.silent_s < silent_s + 0.1
    rig.close()
    assert card.closed is False


def test_drive__input_clips__is_refused_by_its_name():
    rig, _ = turned_rig(sound_display(), answer=lambda out: np.clip(out * [[1.0, 5.0]], -1.0, 1.0).astype(np.float32))
    with pytest.raises(BadInput, match="'right': input 2 of the card clips"):
        rig.drive(commands(3000))


def test_drive__beyond_the_range__is_cut_and_marked():
    rig, _ = turned_rig(sound_display(latency_samples=PERIOD))
    trace = rig.drive(np.full((2000, 2), 1.8))
    assert np.max(trace.command_v) == 1.5
    assert trace.saturated[-1].all()


def test_drive__card_that_stands_still_while_it_starts__is_waited_for():
    rig, card = turned_rig(sound_display(), stops_at=1, stops_for_s=1.7)
    assert len(rig.drive(np.zeros((100, 2)))) == 100
    rig.close()
    assert card.closed is True


def test_close__card_that_fails_in_it__nothing_is_raised_for_all_has_been_answered(monkeypatch):
    rig, card = turned_rig(sound_display())

    def fails(alive: bool) -> None:
        raise DeviceFault("letting go of the sound card: the sound system has failed")

    monkeypatch.setattr(card, "close", fails)
    with rig:
        assert len(rig.drive(np.zeros((100, 2)))) == 100


@pytest.mark.parametrize(
    ("level", "gain", "words"),
    [(600.0, 1e-4, "comfort, 55 dB SL"), (20.0, 1.4 / 20, None), (np.inf, 0.01, "not finite")],
)
def test_play__level__within_comfort_only(level: float, gain: float, words: str | None):
    display = sound_display()
    rig, card = turned_rig(display)
    rig.load(flat_controller(display, gain))
    if words is None:
        rig.play(np.full((100, 2), level))
        return
    with pytest.raises(BadInput, match=words):
        rig.play(np.full((100, 2), level))
    assert not np.any(np.concatenate([*card.put_out, np.zeros((1, 2))]))


def test_play__beyond_the_travel_by_the_model__nothing_of_it_is_put_out():
    loose = sound_display()
    display = replace(loose, channels=tuple(replace(one, travel_mm=1e-5) for one in loose.channels))
    rig, card = turned_rig(display)
    rig.load(flat_controller(display, 0.07, limits=Limits(1.5, 2e-5)))
    with pytest.raises(BadInput, match=r"'left': the reference moves it by .* its travel, 1e-05 mm"):
        rig.play(np.full((2000, 2), 20.0))
    assert not np.any(np.concatenate([*card.put_out, np.zeros((1, 2))]))


def test_load_and_play__closed_loop_or_reshaped_or_nothing_loaded__is_refused():
    display = sound_display(input=0)
    rig, _ = turned_rig(display)
    assert rig.without_sensor == ("left", "right")
    with pytest.raises(BadInput, match="no controller is loaded"):
        rig.play(np.zeros((10, 2)))
    with pytest.raises(BadInput, match="closes a loop"):
        rig.load(flat_controller(display, feedback_sos=np.array([[1.0, 0, 0, 1.0, 0, 0]])))
    with pytest.raises(BadInput, match="'left': its reference is reshaped by its strength"):
        rig.load(flat_controller(display, strength=StrengthShaping(np.array([90.0]), 1.0, np.ones((2, 3)), 0.1)))


def test_stream__fed_far_ahead__a_program_that_computes_for_a_second_is_not_late():
    display = sound_display()
    for far in (False, True):
        rig, card = turned_rig(display, capacity=131072)
        rig.load(flat_controller(display))
        if far:
            rig.feed_far_ahead()
        stream = rig.stream([np.zeros((400, 2))] * 400)
        next(stream)
        card.sleep(1.0)  # the card goes on while the program does something else
        if far:
            list(stream)
            assert rig.rows_played == 160000
        else:
            with pytest.raises(SoundGap, match="too slow to feed"):
                list(stream)
