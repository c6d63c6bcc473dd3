"""Every answered trial of a store as one row of plain values, in the order of the dictionary."""

from __future__ import annotations

from collections.abc import Mapping

from sqlalchemy import Connection, select

from tactuator.errors import BadInput
from tactuator.experiment.store import schema
from tactuator.experiment.store.dictionary import TRIAL_COLUMNS
from tactuator.experiment.store.store import Store

Value = str | int | float | None
TrialRow = Mapping[str, Value]


def trial_rows(store: Store) -> list[TrialRow]:
    """Rows by study, subject, run and trial. Raises BadInput for a store without a response."""
    study, session, run, trial, response = (
        schema.study,
        schema.session,
        schema.run,
        schema.trial,
        schema.response,
    )
    query = (
        select(
            study.c.name.label("study"),
            session.c.subject_code.label("subject"),
            run.c.id.label("run"),
            run.c.state.label("run_state"),
            trial.c.number.label("trial"),
            response.c.server_received_utc.label("received_utc"),
            *(column for column in (*session.c, *run.c, *trial.c, *response.c) if column.name in _NAMES),
            trial.c.id.label("trial_key"),
            response.c.client_shown_ms,
            response.c.client_pressed_ms,
        )
        .select_from(study.join(session).join(run).join(trial).join(response))
        .order_by(study.c.id, session.c.subject_number, run.c.id, trial.c.number)
    )
    with store.read() as connection:
        played = _played(connection)
        rows = [_plain(dict(row._mapping), played) for row in connection.execute(query)]
    if not rows:
        raise BadInput(f"store {store.path} has no response; allowed: one with at least one")
    return rows


_NAMES = {one.name for one in TRIAL_COLUMNS} - {"run", "trial"}


def _played(connection: Connection) -> dict[int, tuple[str, float | None]]:
    """Labels of each trial's intervals, and the level at the sensor where something was commanded."""
    found: dict[int, tuple[str, float | None]] = {}
    for row in connection.execute(
        select(schema.interval).order_by(schema.interval.c.trial_id, schema.interval.c.position)
    ):
        labels, measured = found.get(row.trial_id, ("", None))
        labels = f"{labels}|{row.stimulus}" if labels else row.stimulus
        found[row.trial_id] = (labels, measured if row.commanded_db_sl is None else row.measured_db_sl)
    return found


def _plain(row: dict[str, object], played: Mapping[int, tuple[str, float | None]]) -> TrialRow:
    key = row["trial_key"]
    assert isinstance(key, int)
    labels, measured = played.get(key, ("", None))
    shown, pressed = row["client_shown_ms"], row["client_pressed_ms"]
    known = isinstance(shown, float) and isinstance(pressed, float)
    values: dict[str, object] = {
        **row,
        "stimuli": labels,
        "measured_db_sl": measured,
        "response_time": (pressed - shown) / 1000.0 if known else None,  # type: ignore[operator]
    }
    return {one.name: _value(values[one.name]) for one in TRIAL_COLUMNS}


def _value(value: object) -> Value:
    if isinstance(value, bool):
        return int(value)
    assert value is None or isinstance(value, str | int | float)
    return value
