"""The file of a coupling: the matrix of responses of several channels that `identify` found."""

from __future__ import annotations

import json
from pathlib import Path

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.io.atomic import write_text
from tactuator.io.kinds import require_kind
from tactuator.io.text import read_finite_json
from tactuator.model.coupling import CoupledResponse, measured_of
from tactuator.parameters import plain

COUPLING_FORMAT = "tactuator-coupling/1"


def write_coupling(path: str | Path, response: CoupledResponse) -> None:
    """Write the coupling file, whole or not at all."""
    document = {"format": COUPLING_FORMAT, "tool": __version__, **plain(response)}
    write_text(path, json.dumps(document, allow_nan=False) + "\n")


def read_coupling(path: str | Path) -> CoupledResponse:
    """Read a coupling file. Raises BadInput for a file that cannot be read, or is none."""
    require_kind(Path(path), "coupling")
    document = read_finite_json(Path(path))
    if not isinstance(document, dict) or document.get("format") != COUPLING_FORMAT:
        raise BadInput(f"coupling {path}: format is not {COUPLING_FORMAT!r}", "a file that `identify` wrote")
    try:
        return measured_of({key: value for key, value in document.items() if key not in ("format", "tool")})
    except BadInput as error:
        raise error.within(f"coupling {path}") from None
