"""Display and protocol files to start from: the text of a shipped example, with an identified model in it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from tactuator.errors import BadInput
from tactuator.io.start.shipped import EXAMPLES

if TYPE_CHECKING:  # the kinds are asked for by the command line, which must not load NumPy for that
    from tactuator.model.plant_model import PlantModel

DISPLAY_KINDS = ("tactuator", "voice-coil", "lra", "exciter", "piezo")
PROTOCOL_KINDS = ("imece2004", "up-down", "quest-plus", "curve", "recognition", "middle-of-three", "abx")


def display_template(kind: str) -> str:
    """Return the text of a commented display file for an actuator of that kind; BadInput for another kind."""
    return _text("displays", kind, DISPLAY_KINDS)


def protocol_template(kind: str) -> str:
    """Return the text of a commented protocol file of that kind; BadInput for another kind."""
    return _text("protocols", kind, PROTOCOL_KINDS)


def protocol_items(kind: str) -> dict[str, bytes]:
    """Return the files that a protocol of that kind presents, by their names beside it: sounds and their scales."""
    sounds = [Path(name) for name in re.findall(r'^file = "([^"]+)"', protocol_template(kind), flags=re.MULTILINE)]
    names = [str(name) for sound in sounds for name in (sound, sound.with_suffix(".json"))]
    return {name: (EXAMPLES / "protocols" / name).read_bytes() for name in names}


def _text(folder: str, kind: str, kinds: tuple[str, ...]) -> str:
    if kind not in kinds:
        raise BadInput(f"{kind!r} is no kind that is known", f"{', '.join(kinds)}")
    return (EXAMPLES / folder / f"{kind}.toml").read_text(encoding="utf-8")


def with_model(text: str, model: PlantModel, path: str) -> str:
    """Return the text of a display file whose plant is the model in the file `path`.

    The band is narrowed to the frequencies (Hz) of which the model says something. Loads, which are in the units of a
    plant, and the friction, which the model brings, become comments. Raises BadInput where no band is left.
    """
    low, high = _band(text, model)
    quantity = "" if model.quantity == "displacement" else f'\nquantity = "{model.quantity}"'
    plant = f"plant = {json.dumps(path)}{quantity}"
    changes: tuple[tuple[str, Callable[[re.Match[str]], str]], ...] = (
        (r"^plant = \{[^}]*\}.*$", lambda found: plant),
        (r"^band_hz = \[[^]]*\]", lambda found: f"band_hz = [{low:g}, {high:g}]"),
        (r"^((?:sensor_gain_v_per_mm|travel_mm) = [\d.e-]+ *)#", lambda found: f"{found[1]}# CHANGE THIS:"),
        (r"^(loads|friction_v|presliding_v) = ", lambda found: f"# {found[1]} = "),
    )
    for pattern, change in changes:
        text = re.sub(pattern, change, text, flags=re.MULTILINE)
    return text


def _band(text: str, model: PlantModel) -> tuple[float, float]:
    """Return the template's band (Hz) within that of the model."""
    found = re.search(r"^band_hz = \[([\d.]+), ([\d.]+)\]", text, flags=re.MULTILINE)
    assert found is not None  # every shipped display states its band; a test reads them all
    low, high = float(found[1]), float(found[2])
    if model.valid_hz is not None:
        low, high = max(low, model.valid_hz[0]), min(high, model.valid_hz[1])
    if not low < high:
        raise BadInput(
            f"the model says something from {low:g} Hz up and to {high:g} Hz down, in the band of this kind",
            "a model that covers part of it",
        )
    return low, high
