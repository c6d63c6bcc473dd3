"""Identification experiments in the store: studies with their stimuli and response options, blocks as runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime

from sqlalchemy import Connection, insert, select

from tactuator import __version__
from tactuator.errors import BadInput
from tactuator.experiment import schema
from tactuator.experiment.identification import Block
from tactuator.experiment.identification_items import LoadedItem
from tactuator.experiment.identification_protocol import IdentificationProtocol
from tactuator.experiment.protocol_file import protocol_hash
from tactuator.experiment.records import Answer, Apparatus, Found, stamp
from tactuator.experiment.trial import Trial
from tactuator.rig.trace import Trace


def open_study(
    connection: Connection,
    protocol: IdentificationProtocol,
    text: str,
    items: Mapping[str, LoadedItem],
    now: datetime,
    tokens: Sequence[str],
) -> int:
    """The study of that text, made with sessions, stimuli and response options if it is new.

    Raises BadInput where it is there with other items: their files have changed since.
    """
    digest = protocol_hash(text)
    found = connection.execute(select(schema.study.c.id).where(schema.study.c.protocol_sha256 == digest)).scalar()
    if found is not None:
        _check_items(connection, int(found), items)
        return int(found)
    row = {
        "name": protocol.study.name,
        "protocol_toml": text,
        "protocol_sha256": digest,
        "tool_version": __version__,
        "created_utc": stamp(now),
    }
    study = int(connection.execute(insert(schema.study).values(row).returning(schema.study.c.id)).scalar_one())
    for number, (subject, token) in enumerate(zip(protocol.subject, tokens, strict=True)):
        values = {
            "study_id": study,
            "subject_number": number,
            "subject_code": subject.code,
            "subject_group": subject.group,
            "link_token": token,
            "experimenter": protocol.study.experimenter,
            "created_utc": stamp(now),
            **protocol.circumstances.model_dump(),
        }
        if subject.skin_temperature_c is not None:
            values["skin_temperature_c"] = subject.skin_temperature_c
        connection.execute(insert(schema.session).values(values))
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
    return study


def _check_items(connection: Connection, study: int, items: Mapping[str, LoadedItem]) -> None:
    query = select(schema.stimulus).where(schema.stimulus.c.study_id == study)
    for row in connection.execute(query):
        if row.label not in items or items[row.label].sha256 != row.sha256:
            raise BadInput(
                f"item {row.label!r} is not what it was when the study began; allowed: the same files, or a new study"
            )


def block_run(
    connection: Connection, session: int, block: Block, paradigm: str, apparatus: Apparatus, now: datetime
) -> int:
    """The run of a block, begun if it is not there; its id."""
    where = (schema.run.c.session_id == session, schema.run.c.position == block.position)
    found = connection.execute(select(schema.run.c.id).where(*where)).scalar()
    if found is not None:
        return int(found)
    row = {
        "session_id": session,
        "position": block.position,
        "attempt": 0,
        "state": "running",
        "practice": block.training,
        "paradigm": paradigm,
        "procedure": "fixed",
        "finger": "all",
        "frequency_hz": None,
        "started_utc": stamp(now),
        **vars(apparatus),
    }
    return int(connection.execute(insert(schema.run).values(row).returning(schema.run.c.id)).scalar_one())


def answered(connection: Connection, run: int) -> int:
    """How many trials of a run have their answers."""
    query = (
        select(schema.trial.c.id)
        .join(schema.response, schema.response.c.trial_id == schema.trial.c.id)
        .where(schema.trial.c.run_id == run)
    )
    return len(connection.execute(query).all())


def save_trial(
    connection: Connection, run: int, trial: Trial, traces: Sequence[Trace], presented: datetime, answer: Answer
) -> None:
    """A trial, its intervals and its response: all of it or, with the transaction, nothing."""
    row = {
        "run_id": run,
        "number": trial.number,
        "frequency_hz": None,
        "level_db_sl": None,
        "curve_level_db_re_1um": None,
        "correct_response": trial.correct,
        "presented_utc": stamp(presented),
    }
    key = connection.execute(insert(schema.trial).values(row).returning(schema.trial.c.id)).scalar_one()
    rows = [
        {
            "trial_id": key,
            "position": position,
            "stimulus": label,
            "commanded_db_sl": None,
            "measured_db_sl": None,
            "saturated": bool(trace.saturated.any()),
        }
        for position, (label, trace) in enumerate(zip(trial.stimuli, traces, strict=True))
    ]
    connection.execute(insert(schema.interval), rows)
    values = {
        "trial_id": key,
        "response": answer.response,
        "correct": trial.judge(answer.response),
        "client_shown_ms": answer.client_shown_ms,
        "client_pressed_ms": answer.client_pressed_ms,
        "server_received_utc": stamp(answer.received),
    }
    connection.execute(insert(schema.response).values(values))


def study_sessions(connection: Connection, study: int) -> list[Found]:
    """The study's sessions in order of the subjects."""
    query = select(schema.session).where(schema.session.c.study_id == study).order_by(schema.session.c.subject_number)
    return list(connection.execute(query))
