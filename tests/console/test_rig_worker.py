"""The worker that holds the rig, without its process; and the console's rig as an experiment sees it."""

import json
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactuator.console import rig_worker
from tactuator.console.console_rig import ConsoleRig
from tactuator.console.generator import GeneratorWave
from tactuator.console.rig_calls import MeasureSettings, Points, RigStatus
from tactuator.console.rig_process import RigProcess
from tactuator.console.rig_worker import WAITING_MAX, RigWorker
from tactuator.errors import BadInput, DeviceFault, TimingMissed
from tactuator.experiment.presenter import Halted, Presenter
from tactuator.experiment.session.task import Apparatus
from tactuator.measure.response import stepped_sine
from tactuator.rig.board.link import Mode
from tactuator.rig.rig import Rig
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import LinkDown
from tests.console.rig_page import Host
from tests.rig.sound.turned_card import OVERFLOW, flat_controller, sound_display, turned_rig

TONE = GeneratorWave("tone", 30.0, ("index",), 80.0)


@pytest.fixture
def ordered(controller):
    worker = Host(controller.display)
    yield worker
    worker.quit()


def live(worker, controller, *more, rows=80):
    worker.call("load", controller)
    worker.call("live")
    for call in more:
        worker.call(*call)
    worker.until(lambda: len(worker.rows) >= rows)


def test_live__with_a_tone_touch_and_press__tells_what_the_rig_alone_would(ordered, controller):
    touched = ("touch", "index", "finger"), ("press", "index", 0.2)
    live(ordered, controller, *touched, ("generate", TONE), rows=1600)
    ordered.quit()
    rows = ordered.rows
    assert ordered.status.given_back == ordered.status.fed == len(rows)
    with SimulatedRig(controller.display, 5) as alone:
        alone.load(controller)
        alone.finger("index").touch("finger")
        alone.finger("index").press(np.full(len(rows), 0.2))
        trace = alone.play(rows[:, :3].astype(np.float64))
    # the reference was rounded to single precision on its way here
    np.testing.assert_allclose(rows[:, 3:6], trace.command_v, atol=2e-3)
    np.testing.assert_allclose(rows[:, 6:], trace.position_v, atol=2e-3)
    assert np.max(rows[:, 0]) == pytest.approx(10.0 ** (30.0 / 20.0), rel=0.01)


def test_stop_and_rest__go_silent_and_idle_and_live_goes_on_with_the_next_number(ordered, controller):
    live(ordered, controller, ("generate", TONE), rows=800)
    ordered.call("generate", None)
    ordered.until(lambda: ordered.status.wave is None)
    stopped = len(ordered.rows)
    ordered.until(lambda: len(ordered.rows) >= stopped + 900)
    assert ordered.status.mode == "live"
    assert not np.any(ordered.rows[-300:, :3])
    ordered.call("rest")
    ordered.until(lambda: ordered.status.mode == "idle")
    before = len(ordered.rows)
    ordered.call("live")
    ordered.until(lambda: len(ordered.rows) > before)


def test_measure__point_by_point__is_felt_less_asked_and_what_the_model_expects(ordered, controller):
    ordered.call("measure", *order_of(controller, 30.0, (40.0, 100.0, 250.0), load="finger"))
    ordered.until(lambda: any(each.over for each in ordered.points))
    points = ordered.points
    assert [each.done for each in points] == [1, 2, 3, 3]
    assert [len(each.document["responses"][0]["frequency_hz"]) for each in points] == [1, 2, 3, 3]
    assert len(points[-1].csv.splitlines()) == 4
    ordered.until(lambda: ordered.status.mode == "idle")
    shown = points[-1].document["responses"][0]
    felt_less_asked = np.subtract(shown["level_db_sl"], shown["asked_db_sl"])
    np.testing.assert_allclose(shown["error_db"], felt_less_asked, atol=1e-12)
    np.testing.assert_allclose(np.add(shown["model_db"], shown["unpredicted_db"]), shown["error_db"], atol=1e-12)
    assert shown["worst_first"] == np.argsort(-np.abs(felt_less_asked)).tolist()
    assert np.abs(shown["unpredicted_db"]).max() < 1.5


def test_measurement__that_is_stopped__ends_within_a_point_and_leaves_what_it_has(ordered, controller):
    ordered.call("measure", *order_of(controller, 10.0, tuple(range(20, 50)), confidence_db=0.001, longest_s=600.0))
    ordered.until(lambda: ordered.status.mode == "measuring")
    ordered.call("rest")
    ordered.until(lambda: ordered.status.mode == "idle")
    assert not any(each.over for each in ordered.points)


def test_order__that_cannot_be_obeyed__is_refused_in_words_and_what_goes_on_goes_on(ordered, controller):
    loud = ("generate", GeneratorWave("tone", 80.0, ("index",)))
    for call, words in (
        (("live",), "no controller is loaded"),
        (("generate", TONE), "the rig is not live"),
        (loud, "-60 to 55 dB SL for tone"),
    ):
        if call is loud:
            assert ordered.status.mode == "idle"
            live(ordered, controller)
        before = len(ordered.refusals)
        ordered.call(*call)
        ordered.until(lambda count=before: len(ordered.refusals) > count)
        assert words in ordered.refusals[-1]
    rows = len(ordered.rows)
    ordered.until(lambda: len(ordered.rows) > rows)


@pytest.mark.parametrize(
    ("rig", "error", "words"),
    [("board:socket://127.0.0.1:1", DeviceFault, "one where a board listens"), ("mirror", BadInput, "mirror")],
)
def test_rig__that_cannot_be_opened__a_device_is_told_from_bad_input(controller, rig, error, words):
    with pytest.raises((DeviceFault, BadInput), match=words) as raised:
        RigProcess(rig, controller.display, 0)
    assert type(raised.value) is error


@pytest.mark.parametrize(
    ("error", "mode"), [(LinkDown("the port has vanished"), "gone"), (DeviceFault("worn"), "fault")]
)
def test_rig__that_fails_in_mid_stream__is_told_and_can_be_used_again(ordered, controller, monkeypatch, error, mode):
    live(ordered, controller)

    def broken(rig, reference):
        raise error

    with monkeypatch.context() as patched:
        patched.setattr(SimulatedRig, "play", broken)
        ordered.until(lambda: ordered.status.mode == mode)
    assert str(error) in ordered.status.fault
    if mode == "gone":
        ordered.call("reopen")
        ordered.call("load", controller)
    before = len(ordered.rows)
    ordered.call("live")
    ordered.until(lambda: len(ordered.rows) > before)


@pytest.fixture
def on_card(monkeypatch):
    """A worker on a card that is turned by hand, and the way to give it flags or let it fall silent."""

    def opened(spec, display, seed):
        card.rig, card.turned = turned_rig(display, capacity=65536, flags=lambda call: card.flags)
        return card.rig

    card, flat = SimpleNamespace(flags=0), flat_controller(sound_display())
    monkeypatch.setattr(rig_worker, "open_rig", opened)
    card.worker = Host(flat.display, "sound:card")
    card.worker.call("load", flat)
    yield card
    card.worker.quit()


def test_sound_card__gaps__are_counted_and_spoil_a_trial_alone(on_card):
    worker = on_card.worker
    on_card.flags = OVERFLOW
    for number, fault in ((1, "the sound card reported a gap"), (2, "")):
        worker.call("present", number, (np.ones((4000, 2)),))
        worker.until(lambda count=number: sum(each.over for (each,) in worker.of("take_presented")) == count)
        (end,) = worker.of("take_presented")[-1]
        assert (end.missed, fault in end.fault, end.fault == "") == (bool(fault), True, not fault)
        on_card.flags = 0
    before = len(worker.rows)
    worker.call("live")
    worker.until(lambda: len(worker.rows) > before + 8000)
    on_card.flags = OVERFLOW
    worker.until(lambda: worker.status.gaps > 0 or on_card.rig._rows.gaps > 0)
    on_card.flags, before = 0, len(worker.rows)
    worker.until(lambda: len(worker.rows) > before + 8000)
    assert worker.status.mode == "live"
    worker.call("rest")
    worker.until(lambda: worker.status.mode == "idle")
    assert worker.status.gaps > 0
    before = len(worker.rows)
    worker.call("live")
    worker.until(lambda: len(worker.rows) > before)
    on_card.turned.stops_at = on_card.turned.calls
    worker.until(lambda: worker.status.mode == "gone")
    assert "the sound card has stopped" in worker.status.fault
    worker.thread.join(timeout=10.0)
    assert not worker.thread.is_alive()


def test_board__told_of_its_guard__and_at_rest_when_the_worker_ends(controller, monkeypatch):
    worker = Host(controller.display, "in-process")
    live(worker, controller, ("generate", TONE), rows=400)
    worker.until(lambda: worker.status.guard.get("mode") == "running")
    board, ends = type(worker.worker._opened), []
    close = board.close

    def watched(rig):
        rig.rest()
        ends.append(rig.status())
        close(rig)

    monkeypatch.setattr(board, "close", watched)
    worker.quit()
    assert [(each.mode, each.at_rest) for each in ends] == [(Mode.ARMED, True)]


def order_of(controller, level_db_sl, frequency_hz=(100.0,), load="none", confidence_db=1.0, longest_s=4.0):
    more = {"mains_hz": 0.0, "band_hz": (0.4, 300.0), "frequency_hz": frequency_hz}
    return controller, MeasureSettings(level_db_sl, ("index",), load, confidence_db, longest_s, **more)


def test_measured__sensor_that_stands_still__has_no_level(controller):
    rig, (_, settings) = SimulatedRig(controller.display, 3), order_of(controller, 30.0, longest_s=0.5)
    rig.load(controller)
    (response,) = stepped_sine(rig, settings.frequency_hz, settings)
    still = replace(response, amplitude_v=np.zeros(1, dtype=complex))
    shown = Points.of((still,), controller, settings, over=True).document
    assert json.loads(json.dumps(shown, allow_nan=False))["responses"][0]["level_db_sl"] == [None]
    with pytest.raises(BadInput, match="-60 to 55 dB SL"):  # an amplitude of zero: a page was sent Infinity
        stepped_sine(rig, [100.0], replace(settings, level_db_sl=-(2.0**63)))


def test_orders__beyond_the_limit__are_refused_but_those_that_end_something_or_are_waited_for(controller):
    sent = []
    worker = RigWorker("simulated", controller.display, 1, lambda name, *_: sent.append(name))
    for _ in range(WAITING_MAX + 2):
        worker.call("press", "index", 0.1)
    assert sent == ["take_refusal"] * 2
    for call in (("generate", None), ("rest",), ("rest", 2), ("present", 3, ()), ("quit",)):
        worker.call(*call)
    assert sent == ["take_refusal"] * 2
    worker.run()
    assert sent.count("take_presented") >= 2


@pytest.fixture
def host(controller):
    worker = Host(controller.display)
    worker.until(lambda: worker.status.touch)
    yield worker
    worker.quit()


def wave(count, seed=1):
    return np.random.default_rng(seed).uniform(-3.0, 3.0, (count, 3))


def test_console_rig__two_streams__are_those_of_the_rig_alone(host, controller):
    rig, alone = ConsoleRig(host), SimulatedRig(controller.display, 5)
    rig.load(controller)
    alone.load(controller)
    for seed in (1, 2):
        blocks = [wave(80, seed), wave(33, seed + 7)]
        ours, theirs = list(rig.stream(blocks)), list(alone.stream(blocks))
        for name in ("reference", "command_v", "position_v", "saturated"):
            both = (np.concatenate([getattr(each, name) for each in of]) for of in (ours, theirs))
            assert np.array_equal(*both), name
        assert (rig.rows_played, rig.began_at) == (113, alone.began_at)
    host.until(lambda: len(host.rows) == 226)
    position = np.concatenate([each.position_v for each in theirs]).astype(np.float32)
    assert np.array_equal(host.rows[113:, 6:], position)
    assert isinstance(rig, Rig)
    place = Apparatus(rig, controller, "simulated")
    record = place.record("index")
    assert (place.simulated, record["rig_simulated"], record["speed"]) == (True, True, 1.0)


def test_console_rig__halted_in_a_trial_or_before_it__is_at_rest_and_plays_the_next(host, controller):
    rig = ConsoleRig(host)
    rig.load(controller)
    began = time.monotonic()
    presenter = Presenter(rig, halted=lambda: time.monotonic() - began > 0.2)
    with pytest.raises(Halted):
        presenter.present([np.zeros((40_000, 3))], 0.0, 0.0)
    assert time.monotonic() - began < 9.0  # of ten seconds that would have been played
    assert host.status.mode == "idle"
    assert len(rig.play(wave(50))) == 50

    def ended_at_once(*call):
        host.worker.call(*call)
        host.worker.call("rest")

    host.call = ended_at_once
    assert len(rig.play(wave(4000))) < 4000
    host.call = host.worker.call
    rig.rest()
    assert len(rig.play(wave(50))) == 50


def test_console_rig__whose_rig_fails__says_why_and_plays_on_once_it_can(host, controller, monkeypatch):
    rig = ConsoleRig(host)
    with pytest.raises(BadInput, match="no controller is loaded"):
        rig.play(wave(10))
    rig.load(controller)
    host.presented(None)  # as it is told of a process that has ended between streams; the rig was opened anew since
    assert len(rig.play(wave(50))) == 50
    for error in (DeviceFault("the wire is cut"), TimingMissed("a gap")):

        def broken(self, blocks, error=error):
            raise error
            yield

        with monkeypatch.context() as patched:
            patched.setattr(SimulatedRig, "stream", broken)
            with pytest.raises(type(error), match=str(error)) as raised:
                rig.play(wave(10))
            assert type(raised.value) is type(error)
            host.until(lambda: host.status.mode == "fault")
        assert len(rig.play(wave(10))) == 10
    host.status = RigStatus(mode="gone", fault="nobody is there")
    with pytest.raises(DeviceFault, match="nobody is there"):
        rig.play(wave(10))
    for refused in (lambda: rig.drive(wave(10)), lambda: rig.finger("index")):
        with pytest.raises(BadInput, match="; "):
            refused()


def test_console_rig__whose_process_ends__is_a_fault(controller):
    host = SimpleNamespace(display=controller.display, status=RigStatus(loaded=controller.content_hash))
    rig = ConsoleRig(host)
    host.call = lambda *call: host.presented(None)
    rig.load(controller)
    with pytest.raises(DeviceFault, match="has ended"):
        rig.play(wave(10))
    host.status = RigStatus(mode="gone")
    rig.rest()
