"""The tables of an experiment's database: relational, every quantity a column with its unit in the name."""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import (
    Boolean,
    CheckConstraint,
    Column,
    ColumnElement,
    Float,
    ForeignKey,
    Integer,
    MetaData,
    Select,
    String,
    Table,
    UniqueConstraint,
    false,
    func,
    literal_column,
    or_,
    select,
    true,
)

VERSION = 8
"""Version of these tables; a store with another one is refused."""

tables = MetaData()


class Prose(String):
    """Type of a text that people write for people, and that may name a person."""


def _key(name: str, needed: bool = True, **about: Any) -> Column[Any]:
    """Return a column that refers to the row of another table: `study_id` to that of `study`."""
    return Column(name, Integer, ForeignKey(f"{name.removesuffix('_id')}.id"), nullable=not needed, **about)


def _needed(kind: Any, *names: str) -> list[Column[Any]]:
    return [Column(name, kind, nullable=False) for name in names]


def _optional(kind: Any, *names: str) -> list[Column[Any]]:
    return [Column(name, kind) for name in names]


def _table(name: str, *parts: Any) -> Table:
    return Table(name, tables, Column("id", Integer, primary_key=True), *parts)


schema_version = Table("schema_version", tables, *_needed(Integer, "version"))

study = _table("study", *_needed(String, "name", "created_utc"))

protocol_version = _table(
    "protocol_version",
    _key("study_id"),
    *_needed(Integer, "number"),
    *_needed(String, "toml", "sha256"),
    *_needed(Prose, "reason"),
    *_needed(String, "tool_version", "created_utc"),
    UniqueConstraint("study_id", "number"),
    UniqueConstraint("study_id", "sha256"),
)

subject = _table(
    "subject",
    _key("study_id"),
    *_needed(Integer, "number"),
    *_needed(String, "code", "subject_group"),
    *_optional(String, "participant_id"),
    *_needed(String, "enrolled_utc"),
    *(UniqueConstraint("study_id", column) for column in ("code", "participant_id")),
)

demographic = _table(
    "demographic",
    _key("subject_id"),
    *_needed(String, "name", "unit"),
    *_optional(Prose, "value"),
    UniqueConstraint("subject_id", "name"),
)

session = _table(
    "session",
    _key("study_id"),
    _key("subject_id"),
    *_needed(Integer, "visit"),
    Column("link_token", String, nullable=False, unique=True),
    _key("protocol_version_id", needed=False),
    *_needed(String, "experimenter", "site", "surround"),
    *_optional(Float, "contact_area_mm2", "skin_temperature_c", "preload_n"),
    *_needed(String, "masking_sound"),
    *_optional(Float, "masking_level_db_spl"),
    *_needed(String, "created_utc"),
    *_optional(String, "consented_utc", "consent_version", "consent_sha256", "ended", "ended_utc"),
    UniqueConstraint("subject_id", "visit"),
    CheckConstraint("ended IN ('declined', 'withdrawn', 'withdrawn-discard')", name="session_ended"),
)

run = _table(
    "run",
    _key("session_id"),
    *_needed(Integer, "position", "attempt"),
    *_needed(String, "state"),
    *_needed(Boolean, "practice"),
    *_needed(String, "paradigm", "procedure", "finger"),
    *_optional(Float, "frequency_hz"),
    *_needed(String, "rig", "display", "controller_sha256", "curve", "curve_sha256"),
    *_needed(Float, "sensor_gain_v_per_mm", "band_low_hz", "band_high_hz"),
    *_needed(String, "started_utc"),
    *_optional(String, "ended_utc"),
    _key("protocol_version_id", needed=False),
    Column("respondent", String, nullable=False, server_default="unknown"),
    *_optional(Boolean, "rig_simulated"),
    Column("shown", String, nullable=False, server_default=""),
    *_optional(Float, "rig_rate_hz", "speed"),
    UniqueConstraint("session_id", "position", "attempt"),
    CheckConstraint("state IN ('running', 'done', 'restarted', 'stopped')", name="run_state"),
)

trial = _table(
    "trial",
    _key("run_id"),
    *_needed(Integer, "number"),
    *_optional(Float, "frequency_hz", "level_db_sl", "curve_level_db_re_1um"),
    *_needed(String, "correct_response", "presented_utc"),
    *_optional(String, "ended_utc"),
    Column("presentations", Integer, nullable=False, server_default="1"),
    *_optional(Integer, "rig_tick"),
    UniqueConstraint("run_id", "number"),
)

interval = _table(
    "interval",
    _key("trial_id"),
    *_needed(Integer, "position"),
    *_needed(String, "stimulus"),
    *_optional(Float, "commanded_db_sl", "measured_db_sl"),
    *_needed(Boolean, "saturated"),
    *_optional(Float, "onset_s", "duration_s", "cue_delay_s", "client_lit_ms"),
    UniqueConstraint("trial_id", "position"),
)

response = Table(
    "response",
    tables,
    _key("trial_id", primary_key=True),
    *_needed(String, "response"),
    *_needed(Boolean, "correct"),
    *_optional(Float, "client_shown_ms", "client_pressed_ms"),
    *_needed(String, "server_received_utc"),
    *_optional(Float, "server_after_end_s"),
)

event = _table(
    "event",
    _key("session_id", needed=False),
    *_needed(String, "at_utc"),
    *_needed(Prose, "who"),
    *_needed(String, "kind"),
    *_optional(Integer, "trials"),
    *_needed(Prose, "detail"),
    _key("subject_id", needed=False),
    *_optional(String, "item"),
    *_optional(Prose, "before", "after"),
)

void = _table(
    "void",
    *(_key(name, needed=False, unique=True) for name in ("session_id", "run_id", "trial_id")),
    *_needed(Prose, "reason"),
)
"""Visits, runs and trials that are not to be used; one of the three keys is set."""

stimulus = _table(
    "stimulus",
    _key("study_id"),
    *_needed(String, "label", "source", "sha256"),
    *_needed(Float, "duration_s"),
    UniqueConstraint("study_id", "label"),
)

response_option = _table(
    "response_option",
    _key("study_id"),
    *_needed(Integer, "position"),
    *_needed(String, "label", "key"),
    UniqueConstraint("study_id", "label"),
    UniqueConstraint("study_id", "key"),
)

RUNS = study.join(subject).join(session).join(run)
"""Every run, with whose it is."""
ANSWERED = RUNS.join(trial).join(response)
"""Every answered trial, with what it is of."""
KEPT = session.c.ended.is_distinct_from("withdrawn-discard")
"""Holds of sessions whose answers may be used."""


def _not_void(of: Table) -> ColumnElement[bool]:
    key = void.c[f"{of.name}_id"]
    return of.c.id.not_in(select(key).where(key.is_not(None)))


class Usable(NamedTuple):
    """What holds of the runs, and of their trials, that results and exports are made of."""

    runs: ColumnElement[bool]
    trials: ColumnElement[bool]


USABLE = {False: Usable(KEPT & _not_void(session) & _not_void(run), _not_void(trial)), True: Usable(KEPT, true())}
"""By whether what is void is taken in."""
VOID_RUNS = select(run.c.id).where(
    run.c.session_id.in_(select(void.c.session_id))
    | run.c.id.in_(select(void.c.run_id))
    | run.c.id.in_(select(trial.c.run_id).join(void))
)
"""Selects the runs that are void, or have a void trial."""


def misfits(table: Table) -> Select[Any]:
    """Return the query of how many rows of a table in a file have a cell of another type than its column's, and which
    columns those are. SQLite takes any value into any column; it sorts numbers before texts, and texts before bytes.
    """
    wrong = []
    for column in table.columns:
        beyond = column >= literal_column("x''" if isinstance(column.type, String) else "''")
        wrong.append(beyond.is_(true()) if column.nullable else beyond.is_not(false()))
    columns: list[ColumnElement[Any]] = [func.count(), *map(func.max, wrong)]
    return select(*columns).where(or_(*wrong))
