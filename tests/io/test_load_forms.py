"""Loads on motors that are written in several forms, against the motor with the load added to its denominator.

The oracle is NumPy's: gain/((1 + m)s² + (b + d)s + k + c), whatever the form that the display file has. Every form
responds as the motor does within 0.01 dB over the band, so that the loaded ones have to.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.io.display import parse_display, read_display
from tactuator.model.description import Channel, display_document

HZ = np.geomspace(0.4, 300.0, 200)
S = 2j * np.pi * HZ
UNDAMPED = "two zeros far above, without damping"
Motor = tuple[float, float, float]


def channel(plant: dict[str, Any], load: dict[str, Any], **keys: Any) -> Channel:
    entry = {"name": "x", "sensor_gain_v_per_mm": 0.2, "travel_mm": 10.0, "plant": plant, "loads": [load], **keys}
    return parse_display({"display": {"rate_hz": 4000.0}, "channel": [entry]}).channels[0]


def drawn(rng: np.random.Generator) -> tuple[Motor, dict[str, Any]]:
    """Draw a motor (gain, damping, stiffness) and a finger of up to its own mass."""
    natural = 2.0 * np.pi * np.exp(rng.uniform(np.log(0.5), np.log(80.0)))
    damping, gain = rng.uniform(0.1, 4.0) * natural, np.exp(rng.uniform(np.log(100.0), np.log(1e6)))
    mass, drag, spring = rng.uniform(0.02, 1.0), rng.uniform(1.0, 80.0), rng.uniform(0.0, 5000.0)
    return (gain, damping, natural**2), {"name": "finger", "mass": mass, "damping": drag, "stiffness": spring}


def other_forms(motor: Motor, rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Return tables of plants that respond as the motor does within the band, none in a motor's form."""
    gain, damping, stiffness = motor
    den = [1.0, damping, stiffness]
    far = 2.0 * np.pi * 300.0 * rng.uniform(60.0, 200.0)
    near = 2.0 * np.pi * rng.uniform(1.0, 200.0)
    dipole = near * (1.0 + 2e-4 * rng.standard_normal())
    poles = np.roots(den)
    return {
        "a zero and a pole far above": {"num": [gain, gain * far], "den": np.polymul([1.0, far], den).tolist()},
        UNDAMPED: {"num": [gain / far**2, 0.0, gain], "den": den},
        "a pole far above": {"num": [gain * far], "den": np.polymul([1.0, far], den).tolist()},
        "a pair that nearly cancels": {
            "zeros": [-dipole],
            "poles": [*([root.real, root.imag] for root in poles), -near],
            "gain": gain * near / dipole,
        },
    }


@pytest.mark.parametrize("seed", range(40))
def test_load__one_motor_in_several_forms__is_loaded_alike_or_refused(seed: int) -> None:
    motor, load = drawn(np.random.default_rng(seed))
    gain, damping, stiffness = motor
    mass, drag, spring = load["mass"], load["damping"], load["stiffness"]
    expected = gain / ((1.0 + mass) * S**2 + (damping + drag) * S + stiffness + spring)
    own = {"num": [gain], "den": [1.0, damping, stiffness]}
    scaled = {"num": [3.0 * gain], "den": [3.0, 3.0 * damping, 3.0 * stiffness]}
    heavier = {**load, **{key: 3.0 * load[key] for key in ("mass", "damping", "stiffness")}}
    with pytest.raises(BadInput, match="den begins with 3") as unclear:
        channel(scaled, load)
    assert unclear.value.key == "per"
    assert f"{3.0 * gain:g}, which adds the load to den as it is written, or {gain:g}" in unclear.value.allowed
    for plant, put, per in ((own, load, None), (own, load, gain), (scaled, heavier, 3.0 * gain), (scaled, load, gain)):
        loaded = loaded_response(plant, put if per is None else {**put, "per": per})
        assert apart_db(loaded, expected) < 1e-6
    for name, plant in other_forms(motor, np.random.default_rng(seed)).items():
        with pytest.raises(BadInput) as refused:
            channel(plant, load)
        assert refused.value.key == "per"
        scaled_load = {**load, "per": gain}
        if name == UNDAMPED and drag < mass * damping:  # no point that is touched is like that
            with pytest.raises(BadInput, match="makes the plant unstable"):
                channel(plant, scaled_load)
        else:
            assert apart_db(loaded_response(plant, scaled_load), expected) < 0.05, name


def loaded_response(plant: dict[str, Any], load: dict[str, Any], **keys: Any) -> Any:
    described = channel(plant, load, **keys)
    return described.loaded_plant(described.loads[0]).response(HZ)


def apart_db(response: Any, expected: Any) -> float:
    return float(np.max(np.abs(20.0 * np.log10(np.abs(response / expected)))))


def test_load__a_family_of_another_form__has_the_nominal_plant_s_scale() -> None:
    motor, load = drawn(np.random.default_rng(3))
    gain, damping, stiffness = motor
    own = {"num": [gain], "den": [1.0, damping, stiffness]}
    described = channel(own, load, family=list(other_forms(motor, np.random.default_rng(3)).values()))
    expected = described.loaded_plant(described.loads[0]).response(HZ)
    for member in described.family:
        assert apart_db(described.under(described.loads[0], member).response(HZ), expected) < 0.05


def test_load__a_sensor_of_another_quantity__has_the_form_of_its_displacement() -> None:
    den = [1.0, 60.0, 1600.0]
    load = {"name": "finger", "mass": 0.1, "damping": 40.0, "stiffness": 3000.0}
    expected = 950.0 / (1.1 * S**2 + 100.0 * S + 4600.0)
    for order, quantity in enumerate(("displacement", "velocity", "acceleration")):
        plant = {"num": [950.0] + [0.0] * order, "den": den}
        assert apart_db(loaded_response(plant, load, quantity=quantity), expected * S**order) < 1e-6
    with pytest.raises(BadInput, match=r"^\[\[channel\]\] 'x': per is not stated for load 'finger'"):
        channel({"num": [950.0], "den": den}, load, quantity="velocity")  # a motor's third pole: an integrator


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        ({"num": [-0.1, 950.0], "den": [1.0, 60.0, 1600.0]}, r"zero at \+9500 rad/s, in the right half plane"),
        ({"num": [95000.0], "den": np.polymul([1.0, 100.0], [1.0, 60.0, 1600.0]).tolist()}, "makes the plant unstable"),
    ],
)
def test_load__a_plant_of_no_point_that_is_touched__is_refused(plant: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words) as refused:
        channel(plant, {"name": "spring", "stiffness": 1e5, "per": 950.0})
    assert refused.value.key == "loads"


def test_load__its_scale__is_kept_by_a_display_s_document(tmp_path: Path) -> None:
    path = tmp_path / "display.toml"
    path.write_text(
        '[display]\nrate_hz = 4000\n[[channel]]\nname = "x"\nsensor_gain_v_per_mm = 0.2\ntravel_mm = 10\n'
        "plant = { num = [0.0005, 950.0, 9500000.0], den = [1.0, 10060.0, 601600.0, 16000000.0] }\n"
        'loads = [{ name = "finger", mass = 0.1, damping = 40.0, stiffness = 3000.0, per = 950.0 }]\n'
    )
    display = read_display(path)
    assert parse_display(display_document(display)) == display
    described = display.channels[0]
    lowered = described.loaded_plant(described.loads[0]).response(1.0) / described.plant.response(1.0)
    assert 20.0 * np.log10(abs(lowered)) == pytest.approx(-9.14, abs=0.01)
    path.write_text(path.read_text().replace("per = 950.0", "per = 0.0"))
    with pytest.raises(BadInput, match="per is 0"):
        read_display(path)
