"""Live sound at the console's rig: its worker, and the requests of a page."""

import numpy as np
import pytest
import soundfile

from tactuator.console import rig_worker
from tactuator.console.rig_calls import ListenSettings
from tactuator.errors import DeviceFault
from tactuator.io.shipped import EXAMPLES
from tactuator.rig.sound.stream import CardGone
from tests.console.pages import dropped
from tests.console.rig_page import Host, loaded


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """Syllables for a minute: a machine that is busy elsewhere hears little of them."""
    path = tmp_path_factory.mktemp("long") / "long.wav"
    time = np.arange(16000 * 60) / 16000
    soundfile.write(path, 0.3 * np.sin(2 * np.pi * 150 * time) * (time % 0.5 < 0.35), 16000)
    return path


@pytest.fixture
def worker(controller, long):
    made = Host(controller.display)
    made.file = ListenSettings("direct", 35.0, file=str(long))
    made.call("load", controller)
    yield made
    made.quit()


def heard(worker):
    return [block for (block,) in worker.of("take_heard")]


def listening(worker, until_s=0.5):
    worker.call("listen", worker.file)
    worker.until(lambda: any(block.time_s > until_s for block in heard(worker)))
    assert worker.status.mode == "listening"


def test_listen__file_at_its_own_pace__samples_and_levels_come_and_rest_ends_it(worker):
    listening(worker, until_s=1.0)
    asked, felt = (
        max(getattr(block, f"{what}_db_sl")["index"] for block in heard(worker)) for what in ("asked", "felt")
    )
    assert asked > 20.0
    assert felt == pytest.approx(asked, abs=3.0)
    assert np.abs(worker.rows[:, :3]).max() > 10.0
    worker.call("rest")
    worker.until(lambda: worker.status.mode == "idle")
    blocks, rows = len(heard(worker)), len(worker.rows)
    worker.call("live")
    worker.until(lambda: len(worker.rows) > rows)
    assert len(heard(worker)) == blocks
    assert not worker.rows[rows:, :3].any()


def test_listen__rest_in_mid_sound__silent_within_20_ms_of_the_display_and_no_more_is_taken(worker, monkeypatch):
    tell, rested, felt = worker.worker._tell, [], []
    worker.worker._opened.finger("index").attach(felt.append)

    def tell_and_rest(name, *arguments):
        tell(name, *arguments)
        if name == "take_heard" and not rested and arguments[0].asked_db_sl["index"] > 25.0:
            rested.extend((len(worker.rows), len(felt)))
            worker.call("rest")

    monkeypatch.setattr(worker.worker, "_tell", tell_and_rest)
    worker.call("listen", worker.file)
    worker.until(lambda: rested and worker.status.mode == "idle")
    assert len(worker.rows) == rested[0]
    before, after = np.concatenate(felt[: rested[1]])[-200:], np.concatenate(felt[rested[1] :])
    still = after[80:] - after[-1]  # friction may keep the finger off its middle
    assert np.abs(before).max() > 10.0 * np.abs(still).max()


def test_listen__muted__nothing_is_asked_and_it_goes_on(worker):
    listening(worker)
    worker.call("mute", True)
    worker.until(lambda: heard(worker)[-1].muted and heard(worker)[-1].asked_db_sl["index"] == -120.0)
    assert worker.status.mode == "listening"
    worker.call("mute", False)
    worker.until(lambda: heard(worker)[-1].asked_db_sl["index"] > 10.0)


@pytest.mark.parametrize(("call", "mode"), [(("generate", None), "idle"), (("live",), "live")])
def test_listen__page_leaves_or_another_call__fades_and_ends(worker, call, mode):
    listening(worker)
    worker.call(*call)
    worker.until(lambda: worker.status.mode == mode)
    assert not worker.rows[-1, :3].any()


class Unplugged:
    """A microphone that ends after a moment, as one that is pulled out; or that does not open."""

    rate_hz, piece_s, notes = 16000, 0.0025, ()

    def __init__(self, name):
        if name == "busy":
            raise CardGone("the microphone cannot be opened", "another")
        self.ended, self.fault, self._reads = False, None, 0

    def read(self, now_s):
        self._reads += 1
        self.ended = self._reads > 100
        self.fault = CardGone("the microphone has stopped", "one that stays connected") if self.ended else None
        return np.zeros(64)

    def close(self):
        pass


@pytest.mark.parametrize(("name", "words"), [("busy", "cannot be opened"), ("", "has stopped")])
def test_listen__microphone_fails__refused_in_words_and_the_rig_stays(worker, controller, monkeypatch, name, words):
    monkeypatch.setattr(rig_worker, "Microphone", Unplugged)
    worker.call("listen", ListenSettings("direct", 35.0, microphone=name))
    worker.until(lambda: worker.refusals)
    assert words in worker.refusals[-1]
    listening(worker)


def test_listen__rig_lost__a_fault_and_not_the_microphones(worker, monkeypatch):
    listening(worker)
    monkeypatch.setattr(
        "tactuator.rig.simulated.SimulatedRig.play", lambda rig, rows: (_ for _ in ()).throw(DeviceFault("worn"))
    )
    worker.until(lambda: worker.status.mode == "fault")
    assert "worn" in worker.status.fault
    assert not worker.refusals


def test_listen_request__file__blocks_come_and_stop_ends_it(console, long):
    with loaded(console) as page:
        page.ask("take")
        assert set(page.ask("microphones")) == {"id", "microphones"}
        key = dropped(console.state, long)
        answer = page.ask("listen", settings={"coding": "bands", "level_db_sl": 30.0, "file": key})
        assert answer["command"] == (
            "tactuator listen --controller controller.json --rig simulated --input long.wav --coding bands --level 30"
        )
        page.until(lambda: sum("heard" in each for each in page.others) > 10)
        block = next(each["heard"] for each in reversed(page.others) if "heard" in each)
        assert len(block["felt_db_sl"]) == len(block["asked_db_sl"]) == 3
        for spectrum in (*block["felt_spectrum_db_sl"], *block["asked_spectrum_db_sl"]):
            assert len(spectrum) == len(block["frequency_hz"])
        assert block["dropouts"] >= 0
        assert 0.01 < block["delay_s"][0] <= block["delay_s"][1] < 0.2
        assert page.standing["mode"] == "listening"
        page.ask("mute", muted=True)
        page.until(lambda: any(each.get("heard", {}).get("muted") for each in page.others))
        page.ask("stop")
        page.until(lambda: page.standing["mode"] == "idle")
        page.ask("give")


def test_rest_request__from_a_page_that_watches__ends_live_sound_without_an_answer(console, long):
    with loaded(console) as page:
        page.ask("take")
        page.ask("listen", settings={"coding": "direct", "level_db_sl": 30.0, "file": dropped(console.state, long)})
        page.until(lambda: page.standing["mode"] == "listening")
        page.ask("give")
        page.socket.send('{"id": 0, "do": "rest"}')
        page.until(lambda: page.standing["mode"] == "idle")


def test_listen_request__that_cannot_be_met__refused_in_a_sentence(console, tmp_path):
    (tmp_path / "noise.wav").write_bytes(b"no sound")
    keys = {name: dropped(console.state, path) for name, path in
            {"sound": EXAMPLES / "speech.wav", "none": tmp_path / "noise.wav"}.items()}  # fmt: skip
    with loaded(console) as page:
        refused(page, keys)


def refused(page, keys):
    page.ask("take")
    good = {"coding": "direct", "level_db_sl": 30.0, "file": keys["sound"]}
    for changed, words in (
        ({"coding": "vocoder"}, "no coding"),
        ({"coding": "../../coding.toml"}, "no coding"),
        ({"level_db_sl": 99.0}, "dB SL"),
        ({"file": keys["none"]}, "noise.wav"),
        ({"file": "/etc/passwd"}, "drop it again"),
        ({"gain": 3.0}, "gain"),
    ):
        said = page.ask("listen", settings=good | changed)["error"]
        assert words in said
        assert "\n" not in said
    page.ask("give")
    assert "this page watches" in page.ask("listen", settings=good)["error"]
    page.ask("take")
    page.others.clear()
    page.ask("listen", settings={**good, "file": "", "microphone": "/etc/passwd.wav"})  # a name, never a file
    page.until(lambda: any("refused" in each for each in page.others))
    said = next(each["refused"] for each in page.others if "refused" in each)
    assert any(words in said for words in ("microphone", "sound card", "PortAudio"))  # by what the machine has
    page.ask("give")
