"""The items of a recognition experiment, read from rendered references and checked against the rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sqlalchemy import Connection, insert, select

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.protocol.recognition import RecognitionProtocol
from tactuator.experiment.store import schema
from tactuator.io.reference import content_sha256, open_reference
from tactuator.rig.player import check_reference
from tactuator.rig.rig import Rig

LONGEST_S = 60.0


@dataclass(frozen=True, eq=False)
class LoadedItem:
    """An item with its stimulus.

    reference: (n, channels) in the rig's order, threshold units. sha256: of the reference's samples.
    """

    label: str
    source: str
    reference: FloatArray
    duration_s: float
    sha256: str


def load_items(protocol: RecognitionProtocol, beside: Path, rig: Rig) -> Mapping[str, LoadedItem]:
    """Return every item of the protocol, by label; files lie beside the protocol.

    Raises BadInput for a file that is not a reference for this rig, is beyond comfort, or lasts over a minute.
    """
    items = {}
    for item in protocol.item:
        path = beside / item.file
        reference = open_reference(path)
        if not 0.0 < reference.duration_s <= LONGEST_S:
            raise BadInput(f"item {item.label!r}: {reference.duration_s:g} s", f"above 0, {LONGEST_S:g} at most")
        columns = check_reference(reference, rig)
        samples = np.concatenate(list(reference.blocks()))[:, columns]
        items[item.label] = LoadedItem(item.label, item.file, samples, reference.duration_s, content_sha256(path))
    return items


def keep_items(
    connection: Connection, study: int, protocol: RecognitionProtocol, items: Mapping[str, LoadedItem]
) -> None:
    """Store the items that are new to the study. Raises BadInput where one of them, or its key, has changed."""
    stored = list(connection.execute(select(schema.stimulus).where(schema.stimulus.c.study_id == study)))
    for row in stored:
        if row.label in items and items[row.label].sha256 != row.sha256:
            raise BadInput(
                f"item {row.label!r} is not what it was when the study began", "the same files, or a new study"
            )
    known = {row.label for row in stored}
    stimuli = [
        {"study_id": study, "label": i.label, "source": i.source, "sha256": i.sha256, "duration_s": i.duration_s}
        for i in items.values()
        if i.label not in known
    ]
    if not stimuli:
        return
    connection.execute(insert(schema.stimulus), stimuli)
    options = [
        {"study_id": study, "position": position, "label": item.label, "key": item.key}
        for position, item in enumerate(protocol.item)
        if item.label not in known
    ]
    _refuse_taken_keys(connection, study, [str(option["key"]) for option in options])
    connection.execute(insert(schema.response_option), options)


def _refuse_taken_keys(connection: Connection, study: int, keys: Sequence[str]) -> None:
    """Raise BadInput where a new item's key belongs to another item of the study."""
    options = schema.response_option
    taken = set(connection.execute(select(options.c.key).where(options.c.study_id == study)).scalars())
    for key in keys:
        if key in taken:
            raise BadInput(f"key {key!r} is another item's of this study", "one that none has had")
