"""The files of a calibrated display without loop: display, controller, report, equaliser and response."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import soundfile

from tactuator.io.atomic import atomic_path, write_text
from tactuator.io.controller import write_controller
from tactuator.io.model import write_model
from tactuator.io.record import write_record
from tactuator.measure.open_loop.chain import Calibrated, CalibrationRequest, NoEqualiser
from tactuator.measure.open_loop.take_away import equaliser_document, impulse_response, response_document
from tactuator.model.document import display_document
from tactuator.report.open_loop_page import open_loop_page
from tactuator.signals.record import Record

FILES = ("display.toml", "controller.json", "report.md", "equaliser.json", "response.json")


def write_calibrated(folder: Path, made: Calibrated, asked: CalibrationRequest, rig: str, date: str, gaps: int) -> None:
    """Write FILES into `folder`, and each channel's NAME.equaliser.wav and, where there is a model, NAME.model.json."""
    folder.mkdir(parents=True, exist_ok=True)
    controller = made.controller
    rate_hz = controller.rate_hz
    write_text(folder / "display.toml", toml_text(display_document(controller.display)))
    write_controller(folder / "controller.json", controller)
    write_text(folder / "report.md", open_loop_page(made, asked, rig, date, gaps))
    equalisers = []
    for one, own in zip(made.channels, controller.channels, strict=True):
        if one.followed.model is not None:
            write_model(folder / f"{one.name}.model.json", one.followed.model)
        impulse, volts = impulse_response(own, rate_hz)
        with atomic_path(folder / f"{one.name}.equaliser.wav") as beside:
            soundfile.write(beside, impulse, round(rate_hz), subtype="FLOAT", format="WAV")
        wave = {"file": f"{one.name}.equaliser.wav", "volts_of_1": volts}
        equalisers.append(equaliser_document(own, rate_hz) | {"impulse_response": wave})
    _write_json(folder / "equaliser.json", {"channels": equalisers})
    responses = [response_document(controller, one.name) for one in made.channels]
    _write_json(folder / "response.json", {"channels": responses})


def write_measured(folder: Path, reached: NoEqualiser, rig: str, date: str) -> tuple[str, ...]:
    """Write what was measured before there was no equaliser, and return the files' names: display.toml with the plants
    that were found, and each channel's NAME.record.h5 and, where there is a model, NAME.model.json.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = ["display.toml"]
    write_text(folder / "display.toml", toml_text(display_document(reached.display)))
    for one in reached.known:
        name, heard = one.channel.name, one.heard
        about = {"rig": rig, "channel": name, "display": reached.display.name, "hold": "band-limited", "date": date}
        record = Record(heard.wave.rate_hz, heard.command.ravel(), heard.position.ravel(), about=about)
        write_record(folder / f"{name}.record.h5", record)
        names.append(f"{name}.record.h5")
        if one.followed.model is not None:
            write_model(folder / f"{name}.model.json", one.followed.model)
            names.append(f"{name}.model.json")
    return tuple(names)


def _write_json(path: Path, document: Mapping[str, Any]) -> None:
    write_text(path, json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def toml_text(document: Mapping[str, Any]) -> str:
    """Return the text of a display file with these tables; what is None is left out."""
    lines = []
    for name, table in document.items():
        if name != "channel":
            lines += [f"[{name}]", *_keys(table), ""]
    for channel in document["channel"]:
        lines += ["[[channel]]", *_keys(channel), ""]
    return "\n".join(lines)


def _keys(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {_value(value)}" for key, value in table.items() if value is not None]


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_keys(value)) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(one) for one in value) + "]"
    # numbers, truth values and strings are spelt as in JSON
    return json.dumps(value, ensure_ascii=False)
