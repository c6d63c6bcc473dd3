"""The file environment.json: hum and noise of every channel's sensor, as `noise --write` found them and a display file
names it under [environment].
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.io.atomic import write_text
from tactuator.io.display_schema import EnvironmentKeys, Number, Positive
from tactuator.io.formats.text import read_finite_json
from tactuator.model.description import DISTURBANCES, Environment

FORMAT = "tactuator-environment/1"


class _Measured(BaseModel):
    """Figures of one channel, in the keys of [environment]."""

    model_config = ConfigDict(extra="forbid")

    hum_hz: list[Positive]
    hum_v_peak: list[Number]
    noise_v_rms: Number


def write_environment(path: str | Path, channels: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the keys of [environment] that were found of every channel, by its name, whole or not at all."""
    document = {
        "format": FORMAT,
        "tool": __version__,
        "channels": {name: dict(keys) for name, keys in channels.items()},
    }
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n")


def read_environment(path: str | Path, channel: str) -> dict[str, Any]:
    """Return the keys of [environment] that the file tells of `channel`.

    Raises BadInput for a file that cannot be read, another format, a channel that is not in it, a figure out of range.
    """
    document = read_finite_json(Path(path))
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise BadInput(f"format is not {FORMAT!r}", "a file that `noise --write` wrote")
    channels = document.get("channels")
    if not isinstance(channels, dict) or channel not in channels:
        known = ", ".join(channels) if isinstance(channels, dict) else "none"
        raise BadInput(f"channel {channel!r} is not in it", f"{known}")
    try:
        found = _Measured.model_validate(channels[channel])
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in fault["loc"])
        raise BadInput(f"channel {channel!r}: {key} is {fault['input']!r}", f"{fault['msg'].lower()}") from None
    return found.model_dump()


def with_measured(keys: EnvironmentKeys, beside: Path, channel: str, where: str) -> EnvironmentKeys:
    """Return the keys with those of the file that `measured` names, if it names one."""
    if keys.measured is None:
        return keys
    stated = sorted(keys.model_fields_set & {"hum_hz", "hum_v_peak", "noise_v_rms"})
    if stated:
        raise BadInput(f"{where} environment: both measured and {stated[0]} are given", "one of them")
    path = beside / keys.measured
    try:
        found = read_environment(path, channel)
    except BadInput as error:
        raise error.within(f"{where} measured {path}") from None
    return EnvironmentKeys.model_validate({**keys.model_dump(exclude_unset=True), **found})


def channel_environment(keys: EnvironmentKeys, friction: Mapping[str, float] | None) -> Environment:
    """Return the environment of the file's keys, and the friction of an identified model where the file states none."""
    dumped = keys.model_dump(exclude={"measured"})
    values: dict[str, Any] = {name: tuple(one) if isinstance(one, list) else one for name, one in dumped.items()}
    stated = {_STATES[key] for key in keys.model_fields_set if key in _STATES}
    if friction is not None and "friction" not in stated:
        stated.add("friction")
        values["friction_v"] = float(friction.get("coulomb", 0.0))
        if friction.get("presliding"):
            values["presliding_v"] = float(friction["presliding"])
    if keys.assumed is None:
        values["assumed"] = tuple(what for what in DISTURBANCES if what not in stated)
    return Environment(**values)


_STATES = {"hum_v_peak": "hum", "hum_hz": "hum", "noise_v_rms": "noise", "friction_v": "friction"}
"""Keys of [environment], and the disturbance that each states."""
