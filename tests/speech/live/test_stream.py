"""The live stream on a simulated display: its delay by clicks, its level against a file's, and how it ends."""

from itertools import pairwise

import numpy as np
import pytest

from tactuator.errors import BadInput, DeviceFault, TimingMissed
from tactuator.rig.rig import with_felt
from tactuator.rig.simulated import SimulatedRig
from tactuator.speech.coding import coding_of, live_coding
from tactuator.speech.live.level import LevelSettings
from tactuator.speech.live.run import run_live
from tactuator.speech.live.source import FileSource
from tactuator.speech.live.stream import LiveStream
from tactuator.speech.reading import sentence_path
from tactuator.speech.spoken import speech_signal
from tests.measure.loops import loaded
from tests.speech.rendered import render_array

RATE = 4000


def played(controller, source, coding="direct", rig=None, **level):
    """The stream's last state, and the displacement at the finger ports, mm, (n, channels)."""
    rig = loaded(controller, 5) if rig is None else rig
    felt = {name: [] for name in rig.channels}
    for name, pieces in felt.items():
        rig.finger(name).attach(pieces.append)
    stream = LiveStream(source, controller, coding_of(coding), LevelSettings(**level))
    run_live(stream, rig, source, lambda state: None)
    return stream, np.stack([np.concatenate(pieces) for pieces in felt.values()], axis=1)


@pytest.mark.parametrize(("coding", "gain_db"), [("direct", 85.0), ("bands", 90.0), ("envelope", 90.0)])
def test_live_stream__clicks__felt_within_30_ms_and_40_at_worst(controller, write_sound, coding, gain_db):
    begin = 9600 + 24000 * np.arange(10) + np.random.default_rng(0).integers(0, 4000, 10)
    clicks = np.zeros(24000 * 11)
    clicks[begin] = 0.9
    source = FileSource(write_sound(clicks, 48000))
    stream, felt = played(controller, source, coding, gain_db=gain_db, gate_db=0.0)
    assert stream.state.dropouts == 0
    for channel, column in zip(controller.display.channels, felt.T, strict=True):
        weighted, late = np.abs(as_felt(channel, column)), []
        for at in begin / 48000 * RATE:
            first = int(np.ceil(at))
            late.append((first + np.argmax(weighted[first : first + 400]) - at) / RATE)
        assert np.median(late) <= 0.030
        assert max(late) <= 0.040
        assert min(late) >= 0.010  # less than the buffers alone: something was heard before it came


def as_felt(channel, displacement_mm):
    """Displacement weighted by the inverse threshold curve, with zero phase."""
    weight = 1.0 / channel.threshold.curve.displacement_mm(np.fft.rfftfreq(1 << 17, 1 / RATE))
    return np.fft.irfft(np.fft.rfft(displacement_mm, 1 << 17) * weight)[: displacement_mm.size]


def band_energies(felt):
    """Energy of displacement in the third octaves from 100 to 250 Hz, and from there to 300, dB, of each finger."""
    power = np.abs(np.fft.rfft(felt, 1 << 15, axis=0)) ** 2
    hertz = np.fft.rfftfreq(1 << 15, 1 / RATE)
    edges = [*(1000 * 10.0 ** (np.arange(-10.5, -5) / 10)), 300.0]
    rows = [power[(hertz >= low) & (hertz < high)].sum(axis=0) for low, high in pairwise(edges)]
    return 10 * np.log10(np.stack(rows))


def test_live_stream__recorded_sentence__third_octaves_within_1_db_of_the_file(controller):
    with speech_signal(sentence_path(), controller, coding_of("direct"), 35.0) as signal:
        gain_db = 20 * np.log10(signal.about["threshold_units_per_speech_full_scale"])
    reference, _ = render_array(sentence_path(), controller)
    rig = loaded(controller, 5)
    from_file = np.concatenate([moved for _, moved in with_felt(rig, rig.stream([reference]))])
    stream, live = played(controller, FileSource(sentence_path()), gain_db=gain_db, gate_db=0.0)
    assert stream.state.taken_back_db == 0.0
    np.testing.assert_allclose(band_energies(live), band_energies(from_file), atol=1.0)


def test_live_stream__automatic_gain__comes_to_the_level_from_quiet_and_from_loud(controller, write_sound):
    time = np.arange(16000 * 8) / 16000
    syllables = np.sin(2 * np.pi * 150 * time) * (time % 0.5 < 0.35)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(time.size)
    for amplitude in (0.01, 0.3):
        path = write_sound(amplitude * syllables + noise, subtype="FLOAT")
        stream, _ = played(controller, FileSource(path), level_db_sl=30.0)
        assert stream.state.gain_db + 20 * np.log10(amplitude) == pytest.approx(30.0, abs=2.0)


def test_live_stream__noise_between_words__not_felt_once_it_is_known(controller, write_sound):
    rng, rate = np.random.default_rng(1), 16000
    time = np.arange(rate * 8) / rate
    words = 0.3 * np.sin(2 * np.pi * 150 * time) * (time % 2.0 < 1.0)
    path = write_sound(words + 0.01 * rng.standard_normal(time.size), subtype="FLOAT")
    levels = {}
    for gate_db in (0.0, 10.0):
        stream = LiveStream(
            FileSource(path), controller, coding_of("direct"), LevelSettings(gain_db=60, gate_db=gate_db)
        )
        rows = np.concatenate(list(stream.blocks()))
        levels[gate_db] = [np.std(rows[round(a * RATE) : round(b * RATE)]) for a, b in ((5.6, 5.9), (6.3, 6.9))]
    assert levels[10.0][0] == 0.0 < levels[0.0][0]
    assert levels[10.0][1] == pytest.approx(levels[0.0][1], rel=1e-9)


class Broken:
    """A source of which everything is wrong, in turn."""

    rate_hz, piece_s, notes = 16000, 0.0, ()

    def __init__(self):
        self.ended, self.closed, self._given, self._kind = False, False, 0, 0

    def read(self, now_s):
        count, self._given = int(now_s * self.rate_hz) - self._given, int(now_s * self.rate_hz)
        self._kind, self.ended = self._kind + 1, now_s > 1.0
        return np.full(count, (np.nan, np.inf, -1e300, 1.0)[self._kind // 10 % 4])

    def close(self):
        self.closed = True


@pytest.mark.parametrize("coding", ["direct", "bands", "envelope"])
def test_live_stream__samples_that_are_no_numbers__counted_and_harmless(controller, coding):
    source = Broken()
    stream, felt = played(controller, source, coding)
    assert source.closed
    assert 7000 < stream.state.not_numbers < 10000
    assert np.isfinite(felt).all()
    assert np.abs(felt).max() < 12.5


class Lost(SimulatedRig):
    """A rig that is lost in the middle of a stream; rests: how often it was put to rest."""

    def stream(self, blocks):
        for number, trace in enumerate(super().stream(blocks)):
            if number == 50:
                raise self.fault
            yield trace

    def rest(self, settle_s=1.0):
        self.rests = getattr(self, "rests", 0) + 1
        super().rest(settle_s)


@pytest.mark.parametrize(
    ("fault", "rests"), [(DeviceFault("gone"), 1), (KeyboardInterrupt(), 1), (TimingMissed("dry"), 5)]
)
def test_live_stream__rig_lost__source_closed_and_rig_at_rest(controller, fault, rests):
    rig, source = Lost(controller.display, 5), FileSource(sentence_path())
    rig.load(controller)
    rig.fault, rig.rests, rig.lead_s = fault, 0, 0.001
    with pytest.raises(type(fault)):
        played(controller, source, rig=rig)
    assert rig.rests == rests
    assert rig.lead_s == 0.001 * 2 ** (rests - 1)
    assert source.ended


class LateOnce(Lost):
    """A rig that misses its time once, 0.2 s after it began."""

    fault = TimingMissed("dry")

    def stream(self, blocks):
        yield from super().stream(blocks) if not getattr(self, "rests", 0) else SimulatedRig.stream(self, blocks)


def test_live_stream__rig_that_misses_its_time_once__counted_apart_and_played_on(controller):
    rig = LateOnce(controller.display, 5)
    rig.load(controller)
    stream, felt = played(controller, FileSource(sentence_path()), rig=rig)
    assert (stream.state.missed, stream.state.dropouts) == (1, 0)
    assert np.abs(felt[-RATE * 2 :]).max() > 1e-3


def test_live_stream__stopped_and_muted__fades_within_its_limits_and_ends(controller):
    stream = LiveStream(FileSource(sentence_path()), controller, coding_of("direct"))
    blocks = stream.blocks()
    before = np.concatenate([next(blocks) for _ in range(250)])
    stream.muted = True
    muted = np.concatenate([next(blocks) for _ in range(100)])
    assert np.abs(before[-400:]).max() > 1.0
    assert not muted[round(0.03 * RATE) :].any()
    stream.muted = False
    assert np.abs(np.concatenate([next(blocks) for _ in range(50)])).max() > 1.0
    stream.stop()
    after = np.concatenate(list(blocks))
    assert len(after) <= 0.03 * RATE
    assert not after[-1].any()


def test_live_coding__one_that_does_not_state_its_delay__refused(monkeypatch):
    class Ahead:
        kind = "ahead"

        def signals(self, blocks, rate_in_hz, rate_hz):
            raise NotImplementedError

        def placement(self, fingers):
            raise NotImplementedError

    with pytest.raises(BadInput) as refusal:
        live_coding(Ahead())
    assert "'ahead' cannot be causal" in refusal.value.got
    assert "render" in refusal.value.allowed
