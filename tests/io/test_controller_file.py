"""controller.json: there and back, and files that are none."""

from pathlib import Path

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.controller import read_controller, write_controller
from tactuator.model.controller import AntiWindup, ChannelController, Controller, Limits
from tactuator.model.description import Channel, Display, Threshold
from tactuator.perception.curve import curve
from tactuator.signals.systems import ContinuousSystem

MOTOR = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])
CHANNEL = Channel("index", "index", 0.19898, 12.5, MOTOR, Threshold(curve("bolanowski-1988")))
DISPLAY = Display("one", 4000.0, 1, (CHANNEL,))
SECTION = np.array([[0.1, 0.2, 0.1, 1.0, -0.5, 0.3]])


def made() -> Controller:
    channel = ChannelController(
        "index", 0.004, SECTION, SECTION, AntiWindup((0.5, 0.1)), Limits(10.0, 2.4), ("finger",), {"poles": 4}
    )
    return Controller(DISPLAY, (channel,))


def test_write_controller__there_and_back__has_the_same_hash_and_the_formats_keys(tmp_path: Path) -> None:
    write_controller(tmp_path / "c.json", made())
    again = read_controller(tmp_path / "c.json")
    assert again.content_hash == made().content_hash
    assert again.channels[0].anti_windup.gains == (0.5, 0.1)
    np.testing.assert_array_equal(again.channels[0].prefilter_sos, SECTION)
    document = made().document()
    assert document["format"] == "tactuator-controller/1"
    assert {"tool", "display", "rate_hz", "delay_samples", "channels", "hash"} < set(document)
    assert document["display"]["channel"][0]["curve"]["frequency_hz"][0] == 0.4


def test_controller__channels_of_another_display__is_refused() -> None:
    other = ChannelController("thumb", 0.004, SECTION, None, AntiWindup(), Limits(10.0, 2.4))
    with pytest.raises(BadInput, match="is for channels thumb; the display has index"):
        Controller(DISPLAY, (other,))
    with pytest.raises(BadInput, match="channel 'thumb' is not there; allowed: index"):
        made().channel("thumb")


def test_read_controller__changed_by_hand__is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    write_controller(path, made())
    path.write_text(path.read_text().replace("4000.0", "4001.0"))
    with pytest.raises(BadInput, match="its hash does not fit its contents; allowed: a file as `design` wrote it"):
        read_controller(path)
