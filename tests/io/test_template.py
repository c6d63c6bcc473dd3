"""Display and protocol files to start from."""

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.display import parse_display, read_display
from tactuator.io.model import write_model
from tactuator.io.shipped import DISPLAY_KINDS, display_template, protocol_template, with_model
from tactuator.model.description import TABLES, keys_of
from tactuator.model.plant_model import PlantModel

MODEL = PlantModel(
    np.array([2740.0]), np.array([1.0, 97.0, 305.0]), 0.0, np.zeros((4, 4)), (0.4, 300.0), friction={"coulomb": 8e-3}
)


@pytest.mark.parametrize("kind", DISPLAY_KINDS)
def test_display_template__each_kind__is_a_display_of_one_channel_and_tells_every_key_set_or_as_a_comment(kind):
    text = display_template(kind)
    assert len(parse_display(tomllib.loads(text)).channels) == 1
    assert max(map(len, text.splitlines())) <= 120
    for name in TABLES:
        part = re.search(rf"(?ms)^(# )?\[+{name}\]+.*?(?=^(# )?\[|\Z)", text)[0]
        assert set(re.findall(r"^(?:# )?(\w+) = ", part, flags=re.MULTILINE)) == set(keys_of(name))


@pytest.mark.parametrize("kind", DISPLAY_KINDS)
def test_with_model__each_kind__has_the_plant_and_its_friction(kind, tmp_path):
    write_model(tmp_path / "my model.json", MODEL)
    (tmp_path / "display.toml").write_text(with_model(display_template(kind), MODEL, "my model.json"))
    display = read_display(tmp_path / "display.toml")
    (channel,) = display.channels
    assert channel.plant.polynomials()[1] == pytest.approx([1.0, 97.0, 305.0])
    assert channel.environment.friction_v == 8e-3
    assert channel.loads == ()
    assert channel.environment.assumed == (
        "hum",
        "noise",
        "presliding",
    )  # nobody measured them: what rests on them is not judged
    assert channel.unchanged == ("sensor_gain_v_per_mm", "travel_mm")
    text = (tmp_path / "display.toml").read_text()
    assert "# hum_hz = [60.0, 120.0, 180.0]  # lines" in text  # what holds, not what the template had
    assert "# friction_v = the model's  # Coulomb" in text
    assert not display.touch.adaptive  # what is learnt of a load wants one: the file could not be designed


def test_with_model__that_says_something_of_a_part__narrows_the_band(tmp_path):
    narrow = replace(MODEL, valid_hz=(2.0, 120.0), quantity="velocity")
    write_model(tmp_path / "model.json", narrow)
    (tmp_path / "display.toml").write_text(with_model(display_template("tactuator"), narrow, "model.json"))
    (channel,) = read_display(tmp_path / "display.toml").channels
    assert channel.threshold.band_hz == (2.0, 120.0)
    assert channel.quantity == "velocity"


def test_template__of_another_band_or_an_unknown_kind__refused_with_those_allowed():
    with pytest.raises(BadInput, match="band of this kind"):
        with_model(display_template("lra"), replace(MODEL, valid_hz=(0.1, 20.0)), "model.json")
    for template in (display_template, protocol_template):
        with pytest.raises(BadInput, match=r"'maglev'.*allowed: "):
            template("maglev")
