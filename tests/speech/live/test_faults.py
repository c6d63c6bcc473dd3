"""Faults of a live stream: a source that fails, a computer that dies; limits at the finger, fades without a jump."""

import gc
from dataclasses import replace

import numpy as np
import pytest

from tactuator.io.reference import open_reference
from tactuator.rig.board.link import LinkClient, Mode
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.transport import InProcess
from tactuator.runtime._core import lib
from tactuator.runtime.safety_table import Fault
from tactuator.speech.coding import coding_of
from tactuator.speech.live.level import LevelSettings
from tactuator.speech.live.run import fed_shortly, run_live
from tactuator.speech.live.source import FileSource
from tactuator.speech.live.stream import LiveStream
from tactuator.speech.reading import sentence_path
from tactuator.speech.render import RenderJob, render_file
from tests.measure.loops import loaded
from tests.rig.guard.guarded import Guarded, designed
from tests.speech.live.test_stream import as_felt

RATE, RATE_IN, UNPLUGGED_S = 4000, 16000, 0.997


class Sound:
    """A source of a square wave of full scale that fails in the middle of a block; how: "raises", "ends", or never."""

    rate_hz, piece_s, notes = RATE_IN, 0.0, ()

    def __init__(self, how="never", hertz=60.0, seconds=2.0):
        self.ended, self.how, self._given, self._hertz, self._seconds = False, how, 0, hertz, seconds

    def read(self, now_s):
        if self.how == "raises" and now_s > UNPLUGGED_S:
            raise OSError("unplugged")
        self.ended = now_s > (UNPLUGGED_S if self.how == "ends" else self._seconds)
        times = np.arange(self._given, int(now_s * RATE_IN)) / RATE_IN
        self._given += times.size
        return np.sign(np.sin(2 * np.pi * self._hertz * times))

    def close(self):
        self.ended = True


def felt_of(controller, source, report=lambda trace: None):
    """Displacement at the first finger, mm, and what the stream raised."""
    rig, moved, raised = loaded(controller, 5), [], None
    rig.finger("index").attach(moved.append)
    stream = LiveStream(source, controller, coding_of("direct"), LevelSettings(gain_db=95.0, gate_db=0.0))
    try:
        run_live(stream, rig, source, report)
    except OSError as error:
        raised = error
    return np.concatenate(moved), raised


def felt_units(controller, moved):
    """As felt, in threshold units: a display that friction holds off its middle is let go slowly behind its end."""
    let_go = moved[-1] * (0.5 + 0.5 * np.cos(np.pi * np.arange(20000) / 20000))
    return np.abs(as_felt(controller.display.channel("index"), np.concatenate((moved, let_go))))[: moved.size]


@pytest.mark.parametrize("how", ["raises", "ends"])
def test_source__unplugged_in_mid_block__fades_out_and_is_at_rest_within_a_tenth(controller, how):
    frozen = []

    def look(trace):
        if len(frozen) < 2:  # each look walks through all objects
            frozen.append(gc.get_freeze_count())

    moved, raised = felt_of(controller, Sound(how), look)
    assert min(frozen) > 10_000 > gc.get_freeze_count()  # what is loaded is not searched for garbage meanwhile
    assert (raised is not None) == (how == "raises")
    felt = felt_units(controller, moved)
    end = round(UNPLUGGED_S * RATE)
    assert felt[end - 400 : end].max() > 100.0
    assert felt[: end + 4000].max() <= 10 ** (55 / 20)
    assert felt[end + 400 : end + 3200].max() < 3.0


@pytest.mark.parametrize("hertz", [7.0, 200.0])  # 60 Hz is unplugged above
def test_live_stream__square_waves_of_full_scale__felt_within_comfort_and_travel(controller, hertz):
    moved, _ = felt_of(controller, Sound(hertz=hertz))
    assert 100.0 < felt_units(controller, moved).max() <= 10 ** (55 / 20)
    assert np.abs(moved).max() <= 12.5


def test_board__computer_dies_in_a_live_stream__at_rest_within_0_3_s_as_safety_md_promises():
    controller = designed()
    stream = LiveStream(Sound(), controller, coding_of("direct"), LevelSettings(gain_db=95.0, gate_db=0.0))
    blocks = stream.blocks()
    rows = np.concatenate([next(blocks) for _ in range(250)])
    guarded = Guarded(controller)
    command_v, moved = [], list(guarded.run(rows).displacement_mm[:, 0])
    for _ in range(RATE):  # nobody asks, and no row comes
        lib.tact_simulated_board_period(guarded.simulated, guarded.board, 0)
        command_v.append(max(abs(guarded.simulated.state[channel].motor_v) for channel in range(3)))
        moved.append(guarded.simulated.state[0].displacement_mm)
    assert guarded.mode is Mode.FAULT
    assert Fault(guarded.board.fault) is Fault.SILENCE
    assert not np.any(command_v[round(0.302 * RATE) :])
    assert np.abs(moved).max() <= 12.5
    assert felt_units(controller, np.array(moved)).max() <= 10 ** (55.44 / 20)


def test_live_stream__muted_in_a_tone__fades_without_a_jump(controller, write_sound):
    tone = 0.3 * np.sin(2 * np.pi * 50 * np.arange(3 * RATE_IN) / RATE_IN)
    source = FileSource(write_sound(tone, subtype="FLOAT"))
    stream = LiveStream(source, controller, coding_of("direct"), LevelSettings(gain_db=50.0, gate_db=0.0))
    blocks = stream.blocks()
    steady = np.concatenate([next(blocks) for _ in range(250)])[-1000:, 0]
    stream.muted = True
    fading = np.concatenate([steady, *(next(blocks)[:, 0] for _ in range(20))])
    bend = np.abs(np.diff(fading, 2)).max() / np.abs(np.diff(steady, 2)).max()
    assert np.abs(fading[-100:]).max() == 0.0
    assert bend < 3.0


def test_render_live__a_sentence__what_a_rig_is_given_live(controller, tmp_path):
    given, source = [], FileSource(sentence_path())
    stream = LiveStream(source, controller, coding_of("bands"), LevelSettings(35.0))
    run_live(stream, loaded(controller, 5), source, lambda trace: given.append(trace.reference))
    job = RenderJob(controller, coding_of("bands"), 35.0, live=True)
    rendered = render_file(sentence_path(), tmp_path / "live.wav", job)
    written = np.concatenate(list(open_reference(tmp_path / "live.wav").blocks()))
    np.testing.assert_allclose(written, np.concatenate(given)[: len(written)], atol=1e-3)
    assert rendered.about == {"live": True}
    assert job.settings("speech")["coding"] != replace(job, live=False).settings("speech")["coding"]


class Link(InProcess):
    """A board in this process that runs half a millisecond with every request, once it is on its own."""

    alone = False

    def _let_run(self):
        self.run(2) if self.alone else super()._let_run()


@pytest.mark.slow
@pytest.mark.parametrize("coding", ["direct", "bands", "envelope"])
def test_board__clicks_over_a_link_of_half_a_millisecond__felt_within_30_ms_and_never_dry(coding):
    link, controller = Link(), designed()
    moved = {name: [] for name in ("index", "thumb", "middle")}
    rig = BoardRig(LinkClient(link), controller.display, waits=False, sleep=lambda s: link.run(round(s * RATE)))
    rig.simulate(1)
    rig.load(controller)
    for name, pieces in moved.items():
        rig.finger(name).attach(pieces.append)
    link.alone = True
    clicks = Clicks()
    setting = LevelSettings(gain_db=85.0, gate_db=0.0)
    stream = LiveStream(clicks, controller, coding_of(coding), setting, lambda: link.board.tick / RATE)
    with fed_shortly(rig):
        run_live(stream, rig, clicks, lambda trace: None)
    assert (stream.state.missed, stream.state.dropouts) == (0, 0)
    for pieces in moved.values():
        felt, late = felt_units(controller, np.concatenate(pieces)), []
        for tick in clicks.ticks - rig.began_at:
            first = int(np.ceil(tick))
            late.append((first + np.argmax(felt[first : first + 400]) - tick) / RATE)
        assert 0.014 < np.median(late) <= 0.030
        assert max(late) <= 0.040


class Clicks(Sound):
    """A source of 20 clicks, which knows the board's ticks at which each came."""

    def __init__(self):
        super().__init__(seconds=4.5)
        self._at = (RATE_IN * (0.4 + 0.2 * np.arange(20))).astype(int) + np.random.default_rng(0).integers(0, 800, 20)
        self._begun_s = None

    @property
    def ticks(self):
        return RATE * (self._begun_s + self._at / RATE_IN)

    def read(self, now_s):
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        count = super().read(now_s - self._begun_s).size
        return 0.9 * np.isin(np.arange(self._given - count, self._given), self._at)
