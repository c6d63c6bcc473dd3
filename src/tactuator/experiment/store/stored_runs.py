"""Runs as they are in the store, with their trials, ready for analysis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, select

from tactuator.arrays import FloatArray
from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.protocol.protocol import Protocol
from tactuator.experiment.store import schema
from tactuator.experiment.store.cells import Found
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.study_records import session_query
from tactuator.experiment.trial.trial import IntervalRecord


@dataclass(frozen=True)
class StoredRun:
    """A stored run with its trials.

    session, run: their rows. frequency_hz, levels_db_sl, curve_level_db_re_1um, correct: (trials,). intervals: of all
    trials.
    """

    session: Found
    run: Found
    protocol: Protocol
    frequency_hz: FloatArray
    levels_db_sl: FloatArray
    curve_level_db_re_1um: FloatArray
    correct: NDArray[np.bool_]
    intervals: tuple[IntervalRecord, ...]


def detection_runs(store: Store, state: str = "done") -> list[StoredRun]:
    """Return the runs of that state in all the store's studies, practice left out. Raises BadInput without any."""
    with store.read() as connection:
        asked = select(schema.stimulus.c.study_id)  # identification studies have stimuli of their own
        versions = select(schema.protocol_version).where(schema.protocol_version.c.study_id.not_in(asked))
        protocols = {row.id: parse_protocol(row.toml) for row in connection.execute(versions)}
        kept = schema.session.c.ended.is_distinct_from("withdrawn-discard")
        sessions = {row.id: row for row in connection.execute(session_query().where(kept))}
        query = (
            select(schema.run)
            .where(
                schema.run.c.state == state,
                schema.run.c.practice.is_(False),
                schema.run.c.paradigm == "forced-choice",
                schema.run.c.session_id.in_(select(schema.session.c.id).where(kept)),
            )
            .order_by(schema.run.c.session_id, schema.run.c.position, schema.run.c.attempt)
        )
        runs = [
            _stored(connection, sessions[row.session_id], row, protocols[row.protocol_version_id])
            for row in connection.execute(query)
        ]
    if not runs:
        raise BadInput(f"store {store.path} has no {state} run; allowed: one with at least one")
    return runs


def _stored(connection: Connection, session: Found, run: Found, protocol: Protocol) -> StoredRun:
    query = (
        select(schema.trial, schema.response.c.correct)
        .join(schema.response, schema.response.c.trial_id == schema.trial.c.id)
        .where(schema.trial.c.run_id == run.id)
        .order_by(schema.trial.c.number)
    )
    trials = list(connection.execute(query))
    played = (
        select(schema.interval)
        .join(schema.trial, schema.trial.c.id == schema.interval.c.trial_id)
        .where(schema.trial.c.run_id == run.id)
        .order_by(schema.trial.c.number, schema.interval.c.position)
    )
    intervals = tuple(
        IntervalRecord(
            row.stimulus, row.commanded_db_sl, row.measured_db_sl, bool(row.saturated), row.onset_s, row.duration_s
        )
        for row in connection.execute(played)
    )
    return StoredRun(
        session,
        run,
        protocol,
        np.array([row.frequency_hz for row in trials]),
        np.array([row.level_db_sl for row in trials]),
        np.array([row.curve_level_db_re_1um for row in trials]),
        np.array([row.correct for row in trials], dtype=np.bool_),
        intervals,
    )
