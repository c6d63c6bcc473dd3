"""Environments of a display's channels: the file that `measure noise --write` writes, and the table [environment]."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactuator import __version__
from tactuator.errors import BadInput, named_file, within
from tactuator.io.atomic import write_text
from tactuator.io.kinds import read_document
from tactuator.model.description import DISTURBANCES, Environment, MeasuredEnvironment
from tactuator.parameters import allowed, from_table, parameters, require_known

ENVIRONMENT_FORMAT = "tactuator-environment/1"
_MEASURED = ("hum_hz", "hum_v_peak", "noise_v_rms")


def write_environment(path: str | Path, channels: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the keys of [environment] that were found of every channel, by its name, whole or not at all."""
    found_of = {name: dict(keys) for name, keys in channels.items()}
    document = {"format": ENVIRONMENT_FORMAT, "tool": __version__, "channels": found_of}
    write_text(path, json.dumps(document, indent=1, allow_nan=False) + "\n", "environment")


def read_environment(path: str | Path, channel: str) -> dict[str, Any]:
    """Return the keys of [environment] that the file has for `channel`.

    Raises BadInput for a file that cannot be read, another format, a channel that is not in it, a figure out of range.
    """
    document = read_document(Path(path), "environment", ENVIRONMENT_FORMAT)
    channels = document.get("channels")
    if not isinstance(channels, dict) or channel not in channels:
        known = ", ".join(channels) if isinstance(channels, dict) else "none"
        raise BadInput(f"channel {channel!r} is not in it", f"{known}")
    values = channels[channel]
    where = f"channel {channel!r}"
    if not isinstance(values, dict):
        raise BadInput(f"{where} is {values!r}", "a table")
    require_known(values, dict.fromkeys(_MEASURED), where)
    for key in _MEASURED:
        if key not in values:
            raise BadInput("missing", allowed(parameters(Environment)[key]), where=(where,), key=key)
    from_table(Environment, values, where)
    return values


def channel_environment(
    keys: dict[str, Any], where: str, beside: Path, channel: str, friction: Mapping[str, float] | None
) -> Environment:
    """Return the environment of a file's keys, with the figures of the file that `measured` names, if it names one.

    friction: that of an identified model, for a file that states none; None where the plant is no such model.
    """
    file = from_table(MeasuredEnvironment, {key: keys[key] for key in ("measured",) if key in keys}, where)
    values = {key: value for key, value in keys.items() if key != "measured"}
    if file.measured is not None:
        stated = sorted(set(values) & set(_MEASURED))
        if stated:
            raise BadInput(f"environment: both measured and {stated[0]} are given", "one of them", where=(where,))
        path = beside / file.measured
        with within(where, "measured"), named_file(path, "environment"):
            values |= read_environment(path, channel)
    known = {_STATES[key] for key in values if key in _STATES}
    if friction is not None and "friction" not in known:
        known.add("friction")
        values["friction_v"] = float(friction.get("coulomb", 0.0))
        if friction.get("presliding"):
            values["presliding_v"] = float(friction["presliding"])
    if "presliding_v" in values or not ("friction" in known and values["friction_v"]):
        known.add("presliding")  # nothing rests on it without friction; where friction is assumed, that is reported
    values.setdefault("assumed", tuple(what for what in DISTURBANCES if what not in known))
    return from_table(Environment, values, where)


_STATES = {"hum_v_peak": "hum", "hum_hz": "hum", "noise_v_rms": "noise", "friction_v": "friction"}
"""Keys of [environment], and the disturbance that each states."""
