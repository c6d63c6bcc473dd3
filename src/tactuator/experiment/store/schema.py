"""The tables of an experiment's database: relational, every quantity a column with its unit in the name."""

from __future__ import annotations

from sqlalchemy import (
    Boolean,
    CheckConstraint,
    Column,
    Float,
    ForeignKey,
    Integer,
    MetaData,
    String,
    Table,
    UniqueConstraint,
)

VERSION = 4
"""Version of these tables; a store with another one is refused."""

tables = MetaData()

schema_version = Table("schema_version", tables, Column("version", Integer, nullable=False))

study = Table(
    "study",
    tables,
    Column("id", Integer, primary_key=True),
    Column("name", String, nullable=False),
    Column("created_utc", String, nullable=False),
)

protocol_version = Table(
    "protocol_version",
    tables,
    Column("id", Integer, primary_key=True),
    Column("study_id", Integer, ForeignKey("study.id"), nullable=False),
    Column("number", Integer, nullable=False),
    Column("toml", String, nullable=False),
    Column("sha256", String, nullable=False),
    Column("reason", String, nullable=False),
    Column("tool_version", String, nullable=False),
    Column("created_utc", String, nullable=False),
    UniqueConstraint("study_id", "number"),
    UniqueConstraint("study_id", "sha256"),
)

subject = Table(
    "subject",
    tables,
    Column("id", Integer, primary_key=True),
    Column("study_id", Integer, ForeignKey("study.id"), nullable=False),
    Column("number", Integer, nullable=False),
    Column("code", String, nullable=False),
    Column("subject_group", String, nullable=False),
    Column("participant_id", String),
    Column("enrolled_utc", String, nullable=False),
    UniqueConstraint("study_id", "number"),
    UniqueConstraint("study_id", "code"),
    UniqueConstraint("study_id", "participant_id"),
)

demographic = Table(
    "demographic",
    tables,
    Column("id", Integer, primary_key=True),
    Column("subject_id", Integer, ForeignKey("subject.id"), nullable=False),
    Column("name", String, nullable=False),
    Column("value", String, nullable=False),
    Column("unit", String, nullable=False),
    UniqueConstraint("subject_id", "name"),
)

session = Table(
    "session",
    tables,
    Column("id", Integer, primary_key=True),
    Column("study_id", Integer, ForeignKey("study.id"), nullable=False),
    Column("subject_id", Integer, ForeignKey("subject.id"), nullable=False),
    Column("visit", Integer, nullable=False),
    Column("link_token", String, nullable=False, unique=True),
    Column("protocol_version_id", Integer, ForeignKey("protocol_version.id")),
    Column("experimenter", String, nullable=False),
    Column("site", String, nullable=False),
    Column("surround", String, nullable=False),
    Column("contact_area_mm2", Float),
    Column("skin_temperature_c", Float),
    Column("preload_n", Float),
    Column("masking_sound", String, nullable=False),
    Column("masking_level_db_spl", Float),
    Column("created_utc", String, nullable=False),
    Column("consented_utc", String),
    Column("consent_version", String),
    Column("consent_sha256", String),
    Column("ended", String),
    Column("ended_utc", String),
    UniqueConstraint("subject_id", "visit"),
    CheckConstraint("ended IN ('declined', 'withdrawn', 'withdrawn-discard')", name="session_ended"),
)

run = Table(
    "run",
    tables,
    Column("id", Integer, primary_key=True),
    Column("session_id", Integer, ForeignKey("session.id"), nullable=False),
    Column("position", Integer, nullable=False),
    Column("attempt", Integer, nullable=False),
    Column("state", String, nullable=False),
    Column("practice", Boolean, nullable=False),
    Column("paradigm", String, nullable=False),
    Column("procedure", String, nullable=False),
    Column("finger", String, nullable=False),
    Column("frequency_hz", Float),
    Column("rig", String, nullable=False),
    Column("display", String, nullable=False),
    Column("controller_sha256", String, nullable=False),
    Column("curve", String, nullable=False),
    Column("curve_sha256", String, nullable=False),
    Column("sensor_gain_v_per_mm", Float, nullable=False),
    Column("band_low_hz", Float, nullable=False),
    Column("band_high_hz", Float, nullable=False),
    Column("started_utc", String, nullable=False),
    Column("ended_utc", String),
    Column("protocol_version_id", Integer, ForeignKey("protocol_version.id")),
    Column("respondent", String, nullable=False, server_default="unknown"),
    Column("rig_simulated", Boolean),
    Column("shown", String, nullable=False, server_default=""),
    Column("rig_rate_hz", Float),
    Column("speed", Float),
    UniqueConstraint("session_id", "position", "attempt"),
    CheckConstraint("state IN ('running', 'done', 'restarted', 'stopped')", name="run_state"),
)

trial = Table(
    "trial",
    tables,
    Column("id", Integer, primary_key=True),
    Column("run_id", Integer, ForeignKey("run.id"), nullable=False),
    Column("number", Integer, nullable=False),
    Column("frequency_hz", Float),
    Column("level_db_sl", Float),
    Column("curve_level_db_re_1um", Float),
    Column("correct_response", String, nullable=False),
    Column("presented_utc", String, nullable=False),
    Column("ended_utc", String),
    Column("presentations", Integer, nullable=False, server_default="1"),
    Column("rig_tick", Integer),
    UniqueConstraint("run_id", "number"),
)

interval = Table(
    "interval",
    tables,
    Column("id", Integer, primary_key=True),
    Column("trial_id", Integer, ForeignKey("trial.id"), nullable=False),
    Column("position", Integer, nullable=False),
    Column("stimulus", String, nullable=False),
    Column("commanded_db_sl", Float),
    Column("measured_db_sl", Float),
    Column("saturated", Boolean, nullable=False),
    Column("onset_s", Float),
    Column("duration_s", Float),
    Column("lamp_late_s", Float),
    Column("client_lit_ms", Float),
    UniqueConstraint("trial_id", "position"),
)

response = Table(
    "response",
    tables,
    Column("trial_id", Integer, ForeignKey("trial.id"), primary_key=True),
    Column("response", String, nullable=False),
    Column("correct", Boolean, nullable=False),
    Column("client_shown_ms", Float),
    Column("client_pressed_ms", Float),
    Column("server_received_utc", String, nullable=False),
    Column("server_after_end_s", Float),
)

event = Table(
    "event",
    tables,
    Column("id", Integer, primary_key=True),
    Column("session_id", Integer, ForeignKey("session.id")),
    Column("at_utc", String, nullable=False),
    Column("kind", String, nullable=False),
    Column("trials", Integer),
    Column("detail", String, nullable=False),
    Column("subject_id", Integer, ForeignKey("subject.id")),
    Column("item", String),
    Column("before", String),
    Column("after", String),
)

stimulus = Table(
    "stimulus",
    tables,
    Column("id", Integer, primary_key=True),
    Column("study_id", Integer, ForeignKey("study.id"), nullable=False),
    Column("label", String, nullable=False),
    Column("source", String, nullable=False),
    Column("sha256", String, nullable=False),
    Column("duration_s", Float, nullable=False),
    UniqueConstraint("study_id", "label"),
)

response_option = Table(
    "response_option",
    tables,
    Column("id", Integer, primary_key=True),
    Column("study_id", Integer, ForeignKey("study.id"), nullable=False),
    Column("position", Integer, nullable=False),
    Column("label", String, nullable=False),
    Column("key", String, nullable=False),
    UniqueConstraint("study_id", "label"),
    UniqueConstraint("study_id", "key"),
)
