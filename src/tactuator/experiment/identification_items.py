"""The items of an identification experiment, read from rendered references and checked against the rig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactuator.errors import BadInput
from tactuator.experiment.identification_protocol import IdentificationProtocol
from tactuator.files.reference import content_sha256, open_reference
from tactuator.rig.protocol import Rig
from tactuator.speech.playing import check_reference

LONGEST_S = 60.0


@dataclass(frozen=True, eq=False)
class LoadedItem:
    """reference: (n, channels) in the rig's order, threshold units. sha256: of the reference's samples."""

    label: str
    source: str
    reference: NDArray[np.float64]
    duration_s: float
    sha256: str


def load_items(protocol: IdentificationProtocol, beside: Path, rig: Rig) -> Mapping[str, LoadedItem]:
    """Every item of the protocol, by label; files lie beside the protocol.

    Raises BadInput for a file that is not a reference for this rig, is beyond comfort, or lasts over a minute.
    """
    items = {}
    for item in protocol.item:
        path = beside / item.file
        reference = open_reference(path)
        if not 0.0 < reference.duration_s <= LONGEST_S:
            raise BadInput(f"item {item.label!r}: {reference.duration_s:g} s; allowed: above 0, {LONGEST_S:g} at most")
        columns = check_reference(reference, rig)
        samples = np.concatenate(list(reference.blocks()))[:, columns]
        items[item.label] = LoadedItem(item.label, item.file, samples, reference.duration_s, content_sha256(path))
    return items
