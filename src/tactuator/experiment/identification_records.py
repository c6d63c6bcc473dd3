"""What the store keeps of an identification study besides its sessions: its stimuli and its response options."""

from __future__ import annotations

from collections.abc import Mapping

from sqlalchemy import Connection, insert, select

from tactuator.errors import BadInput
from tactuator.experiment import schema
from tactuator.experiment.identification_items import LoadedItem
from tactuator.experiment.identification_protocol import IdentificationProtocol


def keep_items(
    connection: Connection, study: int, protocol: IdentificationProtocol, items: Mapping[str, LoadedItem]
) -> None:
    """Keep the items of a new study; raise BadInput where a study has others: their files have changed since."""
    stored = list(connection.execute(select(schema.stimulus).where(schema.stimulus.c.study_id == study)))
    for row in stored:
        if row.label not in items or items[row.label].sha256 != row.sha256:
            raise BadInput(
                f"item {row.label!r} is not what it was when the study began; allowed: the same files, or a new study"
            )
    if stored:
        return
    stimuli = [
        {"study_id": study, "label": i.label, "source": i.source, "sha256": i.sha256, "duration_s": i.duration_s}
        for i in items.values()
    ]
    connection.execute(insert(schema.stimulus), stimuli)
    options = [
        {"study_id": study, "position": position, "label": item.label, "key": item.key}
        for position, item in enumerate(protocol.item)
    ]
    connection.execute(insert(schema.response_option), options)
