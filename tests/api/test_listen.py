"""Live sound as a context: what its callback gets, and the rig at rest however it is left."""

import threading

import numpy as np
import pytest
import soundfile

import tactuator as tt
from tactuator.errors import BadInput
from tactuator.rig.rig import with_felt
from tactuator.rig.simulated import SimulatedRig
from tactuator.speech.coding import GROUP
from tactuator.speech.reading import sentence_path

TONE_HZ, AMPLITUDE, GAIN_DB = 150.0, 0.1, 50.0
STILL_MM = 0.003
"""More than hum and noise move a display that nothing plays on."""
LIVE = """
import numpy as np


class Stream:
    rate_in_hz = 16000
    {delay}

    def push(self, block):
        return block[::4, None]


class Thin:
    kind = "thin"

    def signals(self, blocks, rate_in_hz, rate_hz):
        raise NotImplementedError

    def placement(self, fingers):
        return np.ones((1, len(fingers)))

    def live(self, rate_hz, block):
        return Stream()
"""


class Resting(SimulatedRig):
    """rests: how often it was brought to rest; moving: rms of what is felt in the next second, mm."""

    rests = 0

    def rest(self, settle_s=1.0):
        self.rests += 1
        super().rest(settle_s)

    @property
    def moving(self):
        silence = np.zeros((4000, len(self.channels)))
        return np.std(np.concatenate([mm for _, mm in with_felt(self, self.stream([silence]))]))


@pytest.fixture
def rig(controller):
    return Resting(controller.display, 3)


@pytest.fixture(scope="module")
def tone(tmp_path_factory):
    path = tmp_path_factory.mktemp("tone") / "tone.wav"
    soundfile.write(path, AMPLITUDE * np.sin(2 * np.pi * TONE_HZ * np.arange(16000 * 2) / 16000), 16000)
    return path


def test_listen__tone__callback_gets_its_level_asked_and_felt_as_the_finger_port_has_it(controller, rig, tone):
    felt, blocks = [], []
    rig.finger("thumb").attach(felt.append)
    settings = {"gain_db": GAIN_DB, "gate_db": 0.0, "fast": True}
    with tt.listen(rig, controller, tone, **settings, on_block=blocks.append) as live:
        assert live.wait()
    asked_db = GAIN_DB + 20 * np.log10(AMPLITUDE)
    times = np.array([block.time_s for block in blocks])
    assert np.diff(times[times < 1.9]) == pytest.approx(0.05, abs=0.0041)
    steady = [block for block in blocks if 0.6 < block.time_s < 1.9]
    displacement = np.concatenate(felt)[4000:5600] * np.hanning(1600)
    amplitude = 2 * abs(np.exp(-2j * np.pi * TONE_HZ * np.arange(1600) / 4000) @ displacement) / np.hanning(1600).sum()
    truth_db = 20 * np.log10(amplitude / controller.display.channels[1].threshold.curve.displacement_mm(TONE_HZ))
    for block in steady:
        assert block.asked_db_sl["thumb"] == pytest.approx(asked_db, abs=0.2)
        assert block.felt_db_sl["thumb"] == pytest.approx(truth_db, abs=0.5)
        loudest = block.frequency_hz[np.argmax(block.felt_spectrum_db_sl[1])]
        assert loudest == pytest.approx(TONE_HZ, rel=0.06)
        assert 0.013 < block.delay_s[0] <= block.delay_s[1] < 0.03
    result = live.result
    assert (result.stopped, blocks[-1].dropouts, result.state.dropouts) == (False, 0, 0)
    fixed_s = sum(result.delays_s.values())
    stated_s = [fixed_s + f(result.coding_delays_s.values()) for f in (min, max)]
    assert blocks[-1].delay_s == pytest.approx(stated_s)
    assert rig.moving < STILL_MM


def test_listen__exception_in_the_callback__raised_and_the_rig_at_rest(controller, rig):
    called = threading.Event()

    def fails(block):
        called.set()
        raise RuntimeError("of the callback")

    with (
        pytest.raises(RuntimeError, match="of the callback"),
        tt.listen(rig, controller, sentence_path(), fast=True, on_block=fails),
    ):
        called.wait()
    assert rig.rests == 1
    with (
        pytest.raises(RuntimeError, match="of the callback"),
        tt.listen(rig, controller, sentence_path(), fast=True, on_block=fails) as live,
    ):
        live.wait()
    assert rig.rests == 2
    assert rig.moving < STILL_MM
    with pytest.raises(RuntimeError, match="of the callback"):
        tt.listen(rig, controller, sentence_path(), fast=True, on_block=fails).run()


def test_listen__left_by_an_exception_of_the_body__stopped_and_at_rest(controller, rig, tone):
    with pytest.raises(ZeroDivisionError), tt.listen(rig, controller, tone) as live:
        live.muted = True
        1 / 0  # noqa: B018
    assert live.result.stopped
    assert live.result.state.seconds < 1.0
    assert rig.rests >= 1
    assert rig.moving < STILL_MM


def test_listen__coding_of_another_package__works_live_with_its_delay(controller, rig, tone, install):
    install(GROUP, "thin", LIVE.format(delay="delay_s = {100.0: 0.002, 200.0: 0.004}"), "Thin")
    settings = {"coding": "thin", "gain_db": GAIN_DB, "gate_db": 0.0, "fast": True}
    blocks = []
    result = tt.listen(rig, controller, tone, **settings, on_block=blocks.append).run()
    assert result.coding_delays_s == {100.0: 0.002, 200.0: 0.004}
    assert blocks[20].asked_db_sl["index"] == pytest.approx(GAIN_DB + 20 * np.log10(AMPLITUDE), abs=0.2)
    assert blocks[-1].delay_s[1] - blocks[-1].delay_s[0] == pytest.approx(0.002)


@pytest.mark.parametrize("delay", ["pass", "delay_s = {}", "delay_s = {100.0: float('nan')}", "delay_s = 0.004"])
def test_listen__coding_of_another_package_without_a_delay__refused(controller, rig, tone, install, delay):
    install(GROUP, "thin", LIVE.format(delay=delay), "Thin")
    with pytest.raises(BadInput) as refusal:
        tt.listen(rig, controller, tone, coding="thin", fast=True).run()
    assert "'thin' states no delay" in refusal.value.got
    assert "seconds, by the frequency" in refusal.value.allowed
    assert (rig.rests, rig._ticks) == (0, 0)
