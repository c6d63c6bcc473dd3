"""The worker that holds the rig, without its process: what it plays, tells and refuses, and that it ends at rest."""

import json
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactuator.console import rig_orders, rig_worker
from tactuator.console.generator import GeneratorWave
from tactuator.console.rig_orders import WAITING_MAX, WaitingOrders
from tactuator.console.rig_process import RigProcess
from tactuator.console.rig_worker import RigWorker, points_of
from tactuator.errors import BadInput, DeviceFault
from tactuator.measure.response import stepped_sine
from tactuator.rig.board.link import Mode
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.transport import LinkDown
from tests.rig.sound.turned_card import OVERFLOW, flat_controller, sound_display, turned_rig

TONE = GeneratorWave("tone", 30.0, ("index",), 80.0)


class Ordered:
    """A worker on a thread of its own, and all that it has told."""

    def __init__(self, display, spec="simulated"):
        self.told, self.news = [], threading.Condition()
        self.worker = RigWorker(spec, display, 5, self._tell)
        self.thread = threading.Thread(target=self.worker.run, daemon=True)
        self.thread.start()
        self.until(lambda: any(isinstance(one, rig_orders.RigStatus) for one in self.told))

    def _tell(self, told):
        with self.news:
            self.told.append(told)
            self.news.notify_all()

    def order(self, *given):
        for one in given:
            self.worker.order(one)

    def until(self, reached):
        with self.news:
            assert self.news.wait_for(reached, timeout=20.0), self.told[-1]

    @property
    def standing(self):
        return next(one for one in reversed(self.told) if isinstance(one, rig_orders.RigStatus))

    @property
    def rows(self):
        pieces = [one for one in self.told if isinstance(one, rig_orders.Piece)]
        rows = [np.frombuffer(one.content, np.float32).reshape(-1, 9) for one in pieces]
        assert [one.first for one in pieces] == np.cumsum([0, *map(len, rows)])[:-1].tolist()
        return np.concatenate(rows) if rows else np.zeros((0, 9), np.float32)

    def ends(self):
        return [one for one in self.told if isinstance(one, rig_orders.Presented) and one.over]

    def refusals(self):
        return [one.text for one in self.told if isinstance(one, rig_orders.Refused)]

    def quit(self):
        self.order(rig_orders.QuitOrder())
        self.thread.join(timeout=20.0)
        assert not self.thread.is_alive()


@pytest.fixture
def ordered(controller):
    made = Ordered(controller.display)
    yield made
    made.quit()


def test_live__with_a_tone_a_touch_and_a_press__tells_every_sample_as_the_rig_alone_would(ordered, controller):
    ordered.order(
        rig_orders.LoadOrder(controller),
        rig_orders.LiveOrder(),
        rig_orders.TouchOrder("index", "finger"),
        rig_orders.PressOrder("index", 0.2),
    )
    ordered.order(rig_orders.GenerateOrder(TONE))
    ordered.until(lambda: len(ordered.rows) >= 1600)
    ordered.quit()
    rows = ordered.rows
    assert ordered.standing.given_back == ordered.standing.fed == len(rows)
    with SimulatedRig(controller.display, 5) as alone:
        alone.load(controller)
        alone.finger("index").touch("finger")
        alone.finger("index").press(np.full(len(rows), 0.2))
        trace = alone.play(rows[:, :3].astype(np.float64))
    # the reference was rounded to single precision on its way here
    np.testing.assert_allclose(rows[:, 3:6], trace.command_v, atol=2e-3)
    np.testing.assert_allclose(rows[:, 6:], trace.position_v, atol=2e-3)
    assert np.max(rows[:, 0]) == pytest.approx(10.0 ** (30.0 / 20.0), rel=0.01)


def test_stop__of_the_generator__goes_silent_and_the_samples_go_on(ordered, controller):
    ordered.order(rig_orders.LoadOrder(controller), rig_orders.LiveOrder(), rig_orders.GenerateOrder(TONE))
    ordered.until(lambda: len(ordered.rows) >= 800)
    ordered.order(rig_orders.GenerateOrder(None))
    ordered.until(lambda: ordered.standing.wave is None)
    stopped = len(ordered.rows)
    ordered.until(lambda: len(ordered.rows) >= stopped + 900)
    assert ordered.standing.mode == "live"
    assert not np.any(ordered.rows[-300:, :3])


def test_rest__after_live__is_idle_and_live_goes_on_with_the_next_number(ordered, controller):
    ordered.order(rig_orders.LoadOrder(controller), rig_orders.LiveOrder())
    ordered.until(lambda: len(ordered.rows) >= 80)
    ordered.order(rig_orders.RestOrder())
    ordered.until(lambda: ordered.standing.mode == "idle")
    before = len(ordered.rows)
    ordered.order(rig_orders.LiveOrder())
    ordered.until(lambda: len(ordered.rows) > before)


def test_measure__is_told_point_by_point_as_felt_less_asked_and_what_of_it_the_model_expects(ordered, controller):
    order = rig_orders.MeasureOrder(
        controller,
        rig_orders.MeasureSettings(
            30.0, ("index",), "finger", 1.0, 4.0, band_hz=(0.4, 300.0), frequency_hz=(40.0, 100.0, 250.0)
        ),
    )
    ordered.order(order)
    ordered.until(lambda: any(isinstance(one, rig_orders.Points) and one.over for one in ordered.told))
    points = [one for one in ordered.told if isinstance(one, rig_orders.Points)]
    assert [one.done for one in points] == [1, 2, 3, 3]
    assert [len(one.document["responses"][0]["frequency_hz"]) for one in points] == [1, 2, 3, 3]
    assert len(points[-1].csv.splitlines()) == 4
    ordered.until(lambda: ordered.standing.mode == "idle")
    shown = points[-1].document["responses"][0]
    felt_less_asked = np.subtract(shown["level_db_sl"], shown["asked_db_sl"])
    np.testing.assert_allclose(shown["error_db"], felt_less_asked, atol=1e-12)
    np.testing.assert_allclose(np.add(shown["model_db"], shown["unpredicted_db"]), shown["error_db"], atol=1e-12)
    assert shown["worst_first"] == np.argsort(-np.abs(felt_less_asked)).tolist()
    assert np.abs(shown["unpredicted_db"]).max() < 1.5


def test_measurement__that_is_stopped__ends_within_a_point_and_leaves_what_it_has(ordered, controller):
    order = rig_orders.MeasureOrder(
        controller,
        rig_orders.MeasureSettings(
            10.0,
            ("index",),
            "none",
            0.001,
            600.0,
            mains_hz=0.0,
            band_hz=(0.4, 300.0),
            frequency_hz=tuple(range(20, 50)),
        ),
    )
    ordered.order(order)
    ordered.until(lambda: ordered.standing.mode == "measuring")
    ordered.order(rig_orders.RestOrder())
    ordered.until(lambda: ordered.standing.mode == "idle")
    assert not [one for one in ordered.told if isinstance(one, rig_orders.Points) and one.over]


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (rig_orders.LiveOrder(), "no controller is loaded"),
        (rig_orders.GenerateOrder(TONE), "the rig is not live"),
        (rig_orders.TouchOrder("index", "elbow"), "load 'elbow' is not described"),
        (rig_orders.TouchOrder("toe", None), "channel 'toe' is not there"),
        (rig_orders.PressOrder("toe", 1.0), "channel 'toe' is not there"),
    ],
)
def test_order__that_cannot_be_obeyed__is_refused_in_words(ordered, order, words):
    ordered.order(order)
    ordered.until(lambda: ordered.refusals())
    assert words in ordered.refusals()[0]
    ordered.until(lambda: ordered.standing.mode == "idle")


def test_wave__that_cannot_be_played__is_refused_and_live_goes_on(ordered, controller):
    ordered.order(
        rig_orders.LoadOrder(controller),
        rig_orders.LiveOrder(),
        rig_orders.GenerateOrder(GeneratorWave("tone", 80.0, ("index",))),
    )
    ordered.until(lambda: ordered.refusals())
    before = len(ordered.rows)
    ordered.until(lambda: len(ordered.rows) > before)
    assert "allowed: -60 to 55 dB SL for tone" in ordered.refusals()[0]


@pytest.mark.parametrize(("rig", "error"), [("board:socket://127.0.0.1:1", DeviceFault), ("mirror", BadInput)])
def test_host__rig_that_cannot_be_opened__a_device_is_told_from_bad_input(controller, rig, error):
    with pytest.raises((DeviceFault, BadInput)) as raised:
        RigProcess(rig, controller.display, 0)
    assert type(raised.value) is error


def test_rig__that_cannot_be_opened__is_told_as_gone(controller):
    made = Ordered(controller.display, "board:socket://127.0.0.1:1")
    assert made.standing.mode == "gone"
    assert "one where a board listens" in made.standing.fault
    made.quit()


@pytest.mark.parametrize(
    ("error", "mode"), [(LinkDown("the port has vanished"), "gone"), (DeviceFault("worn"), "fault")]
)
def test_rig__that_fails_in_mid_stream__is_told_and_can_be_used_again(ordered, controller, monkeypatch, error, mode):
    ordered.order(rig_orders.LoadOrder(controller), rig_orders.LiveOrder())
    ordered.until(lambda: len(ordered.rows) >= 160)
    whole = SimulatedRig.play

    def broken(rig, reference):
        raise error

    monkeypatch.setattr(SimulatedRig, "play", broken)
    ordered.until(lambda: ordered.standing.mode == mode)
    assert str(error) in ordered.standing.fault
    monkeypatch.setattr(SimulatedRig, "play", whole)
    if mode == "gone":
        ordered.order(rig_orders.ReopenOrder(), rig_orders.LoadOrder(controller))
    before = len(ordered.rows)
    ordered.order(rig_orders.LiveOrder())
    ordered.until(lambda: len(ordered.rows) > before)


@pytest.fixture
def on_card(monkeypatch):
    """A worker on a card that is turned by hand, and the way to give it flags or let it fall silent."""

    def opened(spec, display, seed):
        card.rig, card.turned = turned_rig(display, capacity=65536, flags=lambda call: card.flags)
        return card.rig

    card = SimpleNamespace(flags=0)
    monkeypatch.setattr(rig_worker, "open_rig", opened)
    made = flat_controller(sound_display())
    card.worker = Ordered(made.display, "sound:card")
    card.worker.order(rig_orders.LoadOrder(made))
    yield card
    card.worker.quit()


def rows_told(made):
    return sum(len(one.content) for one in made.told if isinstance(one, rig_orders.Piece)) // (4 * 6)


def test_sound_card__gap_while_live__is_counted_and_goes_on(on_card):
    made = on_card.worker
    made.order(rig_orders.LiveOrder(), rig_orders.GenerateOrder(GeneratorWave("tone", 30.0, ("left",), 80.0)))
    made.until(lambda: rows_told(made) > 8000)
    on_card.flags = OVERFLOW
    made.until(lambda: made.standing.gaps > 0 or on_card.rig._rows.gaps > 0)
    on_card.flags, before = 0, rows_told(made)
    made.until(lambda: rows_told(made) > before + 8000)
    assert made.standing.mode == "live"
    made.order(rig_orders.RestOrder())
    made.until(lambda: made.standing.mode == "idle")
    assert made.standing.gaps > 0


def test_sound_card__gap_in_a_trial__it_is_missed_and_may_be_played_again(on_card):
    made = on_card.worker
    on_card.flags = OVERFLOW
    made.order(rig_orders.PresentOrder(1, (np.ones((4000, 2)),)))
    made.until(lambda: made.ends())
    (end,) = made.ends()
    assert end.missed
    assert "the sound card told of a gap" in end.fault
    on_card.flags = 0
    made.order(rig_orders.PresentOrder(2, (np.ones((4000, 2)),)))
    made.until(lambda: len(made.ends()) == 2)
    assert made.ends()[1].fault == ""


def test_sound_card__falls_silent__the_rig_has_gone_and_the_process_ends(on_card):
    made = on_card.worker
    made.order(rig_orders.LiveOrder())
    made.until(lambda: rows_told(made) > 800)
    on_card.turned.stops_at = on_card.turned.calls
    made.until(lambda: made.standing.mode == "gone")
    assert "the sound card has stopped" in made.standing.fault
    made.thread.join(timeout=10.0)
    assert not made.thread.is_alive()


def test_board__told_of_its_guard__and_at_rest_when_the_worker_ends(controller, monkeypatch):
    made = Ordered(controller.display, "in-process")
    made.order(rig_orders.LoadOrder(controller), rig_orders.LiveOrder(), rig_orders.GenerateOrder(TONE))
    made.until(lambda: len(made.rows) >= 400)
    made.until(lambda: made.standing.guard.get("mode") == "running")
    board, ends = made.worker._opened, []
    close = type(board).close

    def watched(rig):
        rig.rest()
        ends.append(rig.status())
        close(rig)

    monkeypatch.setattr(type(board), "close", watched)
    made.quit()
    assert [(one.mode, one.at_rest) for one in ends] == [(Mode.ARMED, True)]


def order_of(controller, level_db_sl: float) -> rig_orders.MeasureOrder:
    settings = rig_orders.MeasureSettings(
        level_db_sl, ("index",), "none", 1.0, 0.5, mains_hz=0.0, band_hz=(0.4, 300.0), frequency_hz=(100.0,)
    )
    return rig_orders.MeasureOrder(controller, settings)


def loaded(controller) -> SimulatedRig:
    rig = SimulatedRig(controller.display, 3)
    rig.load(controller)
    return rig


def test_points__of_a_sensor_that_stands_still__have_no_level(controller, tmp_path) -> None:
    order = order_of(controller, 30.0)
    (found,) = stepped_sine(loaded(controller), order.settings.frequency_hz, order.settings)
    still = replace(found, amplitude_v=np.zeros(1, dtype=complex))
    shown = points_of((still,), order, tmp_path, over=True).document
    assert json.loads(json.dumps(shown, allow_nan=False))["responses"][0]["level_db_sl"] == [None]


def test_measured__level_of_nothing__refused(controller) -> None:
    """Its amplitude is zero in double precision, and a page was sent Infinity."""
    with pytest.raises(BadInput, match="-60 to 55 dB SL"):
        stepped_sine(loaded(controller), [100.0], order_of(controller, -(2.0**63)).settings)


PRESS = rig_orders.PressOrder("index", 0.1)
PRESENT = rig_orders.PresentOrder(3, (np.zeros((1, 3)),))


def flooded() -> WaitingOrders:
    made = WaitingOrders()
    assert [made.put(PRESS) for _ in range(WAITING_MAX)] == [""] * WAITING_MAX
    return made


def rest_of(waiting: WaitingOrders) -> list[rig_orders.Order]:
    return list(iter(waiting.get_nowait, None))


@pytest.mark.parametrize("order", [PRESS, rig_orders.LiveOrder(), rig_orders.TouchOrder("index", None)])
def test_orders__beyond_the_limit__are_refused_in_words(order) -> None:
    waiting = flooded()
    assert "allowed" in waiting.put(order)
    assert rest_of(waiting) == [PRESS] * WAITING_MAX
    assert waiting.put(order) == ""


@pytest.mark.parametrize("end", [rig_orders.RestOrder(), rig_orders.GenerateOrder(None)])
def test_end__behind_too_many_orders__takes_their_place(end) -> None:
    waiting = flooded()
    assert f"{WAITING_MAX} orders" in waiting.put(end)
    assert rest_of(waiting) == [end]


@pytest.mark.parametrize("order", [PRESENT, rig_orders.AwaitedRestOrder(2), rig_orders.QuitOrder()])
def test_order__that_somebody_waits_for__is_taken_and_outlives_an_end(order) -> None:
    waiting = flooded()
    assert waiting.put(order) == ""
    assert waiting.put(rig_orders.RestOrder())
    assert rest_of(waiting) == [order, rig_orders.RestOrder()]


def test_worker__with_too_many_orders__tells_the_page(controller) -> None:
    told: list[rig_orders.News] = []
    worker = RigWorker("simulated", controller.display, 1, told.append)
    for _ in range(WAITING_MAX + 3):
        worker.order(PRESS)
    assert [type(one) for one in told] == [rig_orders.Refused] * 3
