"""Measured responses: HDF5 with units, or CSV for a spreadsheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.io.atomic import atomic_path
from tactuator.io.csv_text import csv_text
from tactuator.io.hdf5 import opened_hdf5, written_hdf5
from tactuator.io.kinds import require_kind, require_replaceable
from tactuator.signals.record import Response

FORMAT = "tactuator-response/1"
MOST_POINTS = 1_000_000
_ARRAYS = {
    "frequency_hz": "Hz",
    "amplitude_v": "V",
    "reference": "1",
    "confidence_db": "dB",
    "noise_v": "V",
    "distortion_v": "V",
    "saturated": "",
    "reached": "",
    "averaged_s": "s",
}
_TEXTS = ("channel", "load", "method", "controller_hash")
_HEAD = ("channel", "load", "level_db_sl", "method")
_DERIVED = {"magnitude_v": "V", "phase_rad": "rad", "latency_s": "s"}


def check_response_path(path: str | Path) -> None:
    """Refuse a path that responses cannot be written to: a measurement may take an hour."""
    ending = Path(path).suffix.lower()
    if ending not in (".h5", ".hdf5", ".csv"):
        raise BadInput(f"response {path}: ending {ending!r}", ".h5, .hdf5, .csv")
    require_replaceable(Path(path), "measured")


def write_responses(path: str | Path, responses: Sequence[Response]) -> None:
    """Write responses, one group each (.h5, .hdf5), or one row for each point (.csv); whole or not at all."""
    check_response_path(path)
    with atomic_path(path, "measured") as beside:
        if Path(path).suffix.lower() == ".csv":
            beside.write_text(responses_csv(responses), encoding="utf-8", newline="")
        else:
            _write_hdf5(beside, responses)


def _write_hdf5(path: Path, responses: Sequence[Response]) -> None:
    with written_hdf5(path) as written:
        file = written.file
        file.attrs["format"] = FORMAT
        file.attrs["tool"] = __version__
        for number, response in enumerate(responses):
            group = file.create_group(f"response{number + 1}")
            for name in _TEXTS:
                group.attrs[name] = getattr(response, name)
            group.attrs["level_db_sl"] = response.level_db_sl
            for name, unit in (_ARRAYS | _DERIVED).items():
                group.create_dataset(name, data=getattr(response, name))
                group[name].attrs["unit"] = unit


def responses_csv(responses: Sequence[Response]) -> str:
    """Return responses as CSV, one row for each point."""
    columns = ["frequency_hz", "magnitude_v", "phase_rad", "latency_s", *list(_ARRAYS)[2:]]
    rows = (
        [*(getattr(response, name) for name in _HEAD), *map(float, point)]
        for response in responses
        for point in zip(*(getattr(response, name) for name in columns), strict=True)
    )
    return csv_text([*_HEAD, *columns], rows, digits=9)


def read_responses(path: str | Path) -> tuple[Response, ...]:
    """Read measured responses (HDF5) of `measure response --out`. Raises BadInput for another file.

    >>> [response.channel for response in tt.read_responses("response.h5")]
    ['index']
    """
    path = Path(path)
    require_kind(path, "measured")
    try:
        with opened_hdf5(path) as file:
            if file.attrs.get("format") != FORMAT:
                raise BadInput(f"format is not {FORMAT!r}", "a file that `measure response` wrote")
            return tuple(_read_group(file[f"response{k + 1}"]) for k in range(len(file)))
    except BadInput as error:
        raise error.within(f"response {path}") from None
    except (OSError, LookupError, TypeError, ValueError, RuntimeError, AttributeError) as error:
        raise BadInput(
            f"response {path}: {str(error).splitlines()[0]}", "a file that `measure response` wrote"
        ) from None


def _read_group(group: h5py.Group) -> Response:
    texts: dict[str, Any] = {name: str(group.attrs[name]) for name in _TEXTS}
    for data in (group[name] for name in _ARRAYS):
        if max(data.size, *(data.chunks or (0,))) > MOST_POINTS:
            raise BadInput(f"{data.name} has shape {data.shape}", f"up to {MOST_POINTS} points")
    arrays: dict[str, Any] = {name: np.asarray(group[name]) for name in _ARRAYS}
    return Response(level_db_sl=float(group.attrs["level_db_sl"]), **texts, **arrays)
