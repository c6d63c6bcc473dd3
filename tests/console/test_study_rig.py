"""The console's rig as an experiment sees it: it plays what the rig alone would, stops at once, and tells of faults."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from tactuator.console import rig_orders
from tactuator.console.rig_session import Controls, Page
from tactuator.console.study import ConsoleRig
from tactuator.errors import BadInput, DeviceFault, TimingMissed
from tactuator.experiment.presenter import Halted, Presenter
from tactuator.experiment.session.task import Apparatus
from tactuator.rig.rig import Rig
from tactuator.rig.simulated import SimulatedRig
from tests.console.rig_page import Ordered


@pytest.fixture
def host(controller):
    worker = Ordered(controller.display)
    worker.until(lambda: worker.status.touch)
    yield worker
    worker.quit()


def wave(count, seed=1):
    return np.random.default_rng(seed).uniform(-3.0, 3.0, (count, 3))


def test_console_rig__two_streams__are_those_of_the_rig_alone_and_the_scope_sees_them(host, controller):
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
    host.worker._halt.set()  # as by an order to rest that is still under way
    assert len(rig.play(wave(400))) == 0
    rig.rest()
    assert len(rig.play(wave(50))) == 50


def test_console_rig__whose_rig_or_process_fails_or_has_gone__says_why_and_plays_on_once_it_can(
    host, controller, monkeypatch
):
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
    host.status = rig_orders.RigStatus(mode="gone", fault="nobody is there")
    with pytest.raises(DeviceFault, match="nobody is there"):
        rig.play(wave(10))
    for refused in (lambda: rig.drive(wave(10)), lambda: rig.finger("index")):
        with pytest.raises(BadInput, match="allowed"):
            refused()


def test_console_rig__whose_process_ends_in_a_stream__is_a_fault_and_rest_returns(controller):
    host = SimpleNamespace(display=controller.display, status=rig_orders.RigStatus(loaded=controller.content_hash))
    rig = ConsoleRig(host)
    host.order = lambda order: host.presented(None)
    rig.load(controller)
    with pytest.raises(DeviceFault, match="has ended"):
        rig.play(wave(10))
    host.status = rig_orders.RigStatus(mode="gone")
    rig.rest()


def test_controls__of_an_experiment__are_no_pages_until_it_is_over():
    controls, page, other = Controls(), Page(), Page()
    controls.enter(page)
    with pytest.raises(BadInput, match="another page has the controls"):
        controls.reserve(lambda: None)
    controls.give(page)
    controls.reserve(lambda: None)
    controls.enter(other)
    for attempt in (controls.take, controls.require):
        with pytest.raises(BadInput, match="an experiment has the rig"):
            attempt(page)
    with pytest.raises(BadInput, match="end that one first"):
        controls.reserve(lambda: None)
    controls.free()
    controls.take(other)
    assert controls.holder is other
