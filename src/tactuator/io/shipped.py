"""The examples that come with tactuator: copied out, and as display and protocol files to start from."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import scipy

from tactuator.errors import BadInput, unknown
from tactuator.io.atomic import check_folder, write_files
from tactuator.io.reference import ReferenceHead, curves_of, open_reference, write_reference
from tactuator.model.description import TABLES, Display, keys_of
from tactuator.model.plant_model import PlantModel
from tactuator.parameters import default
from tactuator.signals.spectra import off_mains

_WIDTH = 120

DISPLAY_KINDS = ("tactuator", "voice-coil", "lra", "exciter", "piezo")
_SET_BY_FILES = {
    "family", "models", "covariance", "valid_hz", "model_error_db", "model_error_hz", "recorded", "unchanged",
    "assumed",
}  # fmt: skip
"""Keys that come with a model, or that the reader fills in: not for a person who writes a first display file."""
_EXAMPLES_OF_KEYS = {
    "loads": '[{ name = "finger", mass = 0.25, damping = 25.0, stiffness = 15000.0 }]',
    "mass_kg": "0.02", "sensor_gain_v_per_n": "0.1", "measured": '"environment.json"', "contours": '"contours.csv"',
    "controller": "{ num = [12.264, 1361.3, 6499.9], den = [1, 260, 0] }", "area_mm2": "30.0",
    "preload_n": "0.5", "age_years": "[20.0, 30.0]", "output": "1", "input": "1", "output_full_scale_v": "2.83",
}  # fmt: skip
"""Values, as TOML writes them, for keys without a default that could be written."""

_TO_CHANGE = {
    "sensor_gain_v_per_mm", "travel_mm", "plant", "loads", "bits", "range_v", "hum_v_peak", "noise_v_rms", "friction_v",
    "presliding_v",
}  # fmt: skip
"""Keys of a device: what a template has for them is typical of its kind. `check` does not judge by it."""

PROTOCOL_KINDS = ("imece2004", "up-down", "quest-plus", "curve", "recognition", "middle-of-three", "abx")


def display_template(kind: str) -> str:
    """Return the text of a commented display file for an actuator of that kind; BadInput for another kind."""
    return _commented(_text("displays", kind, DISPLAY_KINDS))


def _commented(text: str) -> str:
    """Return the text of a display with the meaning of its keys, and with the keys that it leaves out as comments."""

    def with_keys(name: str, table: str) -> str:
        lines = []
        for line in table.rstrip().splitlines():
            given = re.match(r"(\w+) = ", line)
            meaning = "" if given is None or "#" in line else f"  # {keys_of(name)[given[1]].description}"
            described = line + meaning if len(line + meaning) <= _WIDTH else line
            lines.append(_marked(described) if given is not None and given[1] in _TO_CHANGE else described)
        left_out = {key: about for key, about in keys_of(name).items() if not re.search(rf"(?m)^{key} = ", table)}
        lines += [_left_out(key, about) for key, about in left_out.items() if key not in _SET_BY_FILES]
        return "\n".join(lines) + "\n"

    head, *parts = re.split(r"(?m)^(?=\[)", text)
    tables = {str(re.match(r"\W*(\w+)", part)[1]): part for part in parts}  # type: ignore[index]
    return head + "\n".join(with_keys(name, tables.get(name, f"# [{name}]\n")) for name in TABLES)


def _marked(line: str) -> str:
    """Return a line of a template with the mark of a value that is typical of the kind, and was not measured."""
    value, mark, meaning = line.partition("# ")
    marked = f"{value}# CHANGE THIS: {meaning}"
    return marked if mark and len(marked) <= _WIDTH else f"{value.rstrip()}  # CHANGE THIS"


def _left_out(key: str, about: Any, value: str = "", note: str = "") -> str:
    """Return a line that is TOML once its first "# " is removed: with the default, or with an example of a value."""
    example = _EXAMPLES_OF_KEYS.get(key, "")
    line = f"# {key} = {value or example or default(about)}  # {note}{'for example; ' if example else ''}"
    meaning = re.sub(r"\[(.*?)\]\(.*?\)", r"\1", about.description)
    while len(line + meaning) > _WIDTH:  # its last clause goes
        meaning = re.sub("(^|[;:] )[^;:]*$", "", meaning)
    return line + meaning


def protocol_files(kind: str, display: Display) -> dict[str, bytes]:
    """Return the files of a protocol that the display can play, by name: protocol.toml, and the sounds that it presents
    with their scales, all of them on every channel where these are not the three of display.toml.

    The finger is index where there is one. Frequencies keep to the band and off mains; without any it is the middle.
    Raises BadInput for another kind.
    """
    channel = next((each for each in display.channels if each.finger == "index"), display.channels[0])
    low, high = channel.threshold.band_hz

    def playable(line: re.Match[str]) -> str:
        inside = [hertz for hertz in json.loads(line[1]) if low <= hertz <= high] or [round((low * high) ** 0.5, 1)]
        moved = off_mains(inside, display.channels[0].environment.mains_hz, band_hz=(low, high))
        return f"frequencies_hz = [{', '.join(f'{hertz:g}' for hertz in moved)}]"

    text = re.sub(r"(?m)^frequencies_hz = (\[.*?\])", playable, _text("protocols", kind, PROTOCOL_KINDS))
    text = re.sub(r"(?m)^fingers = \[.*?\]", f"fingers = {json.dumps([channel.finger])}", text)
    names = tuple(each.name for each in display.channels)
    head = ReferenceHead(display.rate_hz, names, curves_of(display.channels), provenance={"example": kind})
    with TemporaryDirectory() as folder:
        for name in re.findall(r'(?m)^file = "([^"]+)"', text):
            shipped = open_reference(EXAMPLES / "protocols" / name)
            (samples,) = shipped.blocks(shipped.frames)
            if shipped.head.channels != names:
                samples = samples.sum(axis=1, keepdims=True).repeat(len(names), axis=1)
            with write_reference(Path(folder, name), head) as writer:
                writer.write(scipy.signal.resample(samples, round(shipped.duration_s * head.rate_hz)))
        files = {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
    return {"protocol.toml": text.encode(), **files}


def _text(folder: str, kind: str, kinds: tuple[str, ...]) -> str:
    if kind not in kinds:
        raise unknown("kind", kind, kinds)
    return (EXAMPLES / folder / f"{kind}.toml").read_text(encoding="utf-8")


def with_model(text: str, model: PlantModel, path: str) -> str:
    """Return the text of a display file whose plant is the model in the file `path`.

    The band is narrowed to the frequencies (Hz) of which the model says something. Loads, which are in the units of a
    plant, what is learnt of them, friction, which the model brings, hum and noise, which were not measured, become
    comments with what holds without them. Raises BadInput where no band is left.
    """
    keys, (low, high) = {**keys_of("environment"), **keys_of("touch")}, _band(text, model)
    quantity = "" if model.quantity == "displacement" else f'\nquantity = "{model.quantity}"'
    recorded = f"  # the record has {model.record['rate_hz']:g}" if "rate_hz" in model.record else ""
    plant = f"plant = {json.dumps(path)}{quantity}"
    friction = {"friction_v": model.friction.get("coulomb"), "presliding_v": model.friction.get("presliding")}

    def known_friction(line: re.Match[str]) -> str:
        value = friction[line[1]]
        return _left_out(line[1], keys[line[1]], "" if value is None else f"{value:.4g}", "default: the model's; ")

    changes: tuple[tuple[str, Callable[[re.Match[str]], str]], ...] = (
        (r"^plant = \{[^}]*\}.*$", lambda line: plant),
        (r"^band_hz = \[[^]]*\]", lambda line: f"band_hz = [{low:g}, {high:g}]"),
        (r"^rate_hz = [\d.]+", lambda line: line[0] + recorded),
        (r"^loads = ", lambda line: f"# {line[0]}"),
        (r"^(adaptive|hum_hz|hum_v_peak|noise_v_rms) = .*", lambda line: _left_out(line[1], keys[line[1]])),
        (r"^(?:# )?(friction_v|presliding_v) = .*", known_friction),
    )
    for pattern, change in changes:
        text = re.sub(pattern, change, text, flags=re.MULTILINE)
    return text


def _band(text: str, model: PlantModel) -> tuple[float, float]:
    band = re.search(r"^band_hz = \[([\d.]+), ([\d.]+)\]", text, flags=re.MULTILINE)
    assert band is not None  # every shipped display states its band; a test reads them all
    low, high = float(band[1]), float(band[2])
    if model.valid_hz is not None:
        low, high = max(low, model.valid_hz[0]), min(high, model.valid_hz[1])
    if not low < high:
        raise BadInput(
            f"the model says something from {low:g} Hz up and to {high:g} Hz down, in the band of this kind",
            "a model that covers part of it",
        )
    return low, high


EXAMPLES = Path(__file__).parent / "examples"
"""The folder of examples in the installed package."""


def example_names() -> tuple[str, ...]:
    """Return the paths of all examples, relative to their folder, in alphabetical order."""
    return tuple(sorted(path.relative_to(EXAMPLES).as_posix() for path in EXAMPLES.rglob("*") if path.is_file()))


def copy_examples(folder: Path) -> tuple[Path, ...]:
    """Write a copy of every example into `folder`, which is made if it is not there, and return the paths written.

    A file that is there already with the same content stays. Raises BadInput, with nothing written, for one with
    another content, and for a folder that cannot be written.
    """
    check_folder(folder)
    contents = {folder / name: (EXAMPLES / name).read_bytes() for name in example_names()}
    write_files(contents)
    return tuple(contents)
