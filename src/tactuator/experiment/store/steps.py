"""Statements that brought a store from each schema version to the next, as they were; they never change again.

The tables of today are in `schema`; a test compares the two.
"""

from __future__ import annotations

THRESHOLDS = (
    "CREATE TABLE schema_version (version INTEGER NOT NULL)",
    """CREATE TABLE study (
        id INTEGER NOT NULL PRIMARY KEY, name VARCHAR NOT NULL, protocol_toml VARCHAR NOT NULL,
        protocol_sha256 VARCHAR NOT NULL UNIQUE, tool_version VARCHAR NOT NULL, created_utc VARCHAR NOT NULL)""",
    """CREATE TABLE session (
        id INTEGER NOT NULL PRIMARY KEY, study_id INTEGER NOT NULL REFERENCES study (id),
        subject_number INTEGER NOT NULL, subject_code VARCHAR NOT NULL, subject_group VARCHAR NOT NULL,
        link_token VARCHAR NOT NULL UNIQUE, experimenter VARCHAR NOT NULL, site VARCHAR NOT NULL,
        surround VARCHAR NOT NULL, contact_area_mm2 FLOAT, skin_temperature_c FLOAT, preload_n FLOAT,
        masking_sound VARCHAR NOT NULL, masking_level_db_spl FLOAT, created_utc VARCHAR NOT NULL,
        consented_utc VARCHAR, UNIQUE (study_id, subject_code))""",
    """CREATE TABLE run (
        id INTEGER NOT NULL PRIMARY KEY, session_id INTEGER NOT NULL REFERENCES session (id),
        position INTEGER NOT NULL, attempt INTEGER NOT NULL, state VARCHAR NOT NULL, practice BOOLEAN NOT NULL,
        paradigm VARCHAR NOT NULL, procedure VARCHAR NOT NULL, finger VARCHAR NOT NULL, frequency_hz FLOAT,
        rig VARCHAR NOT NULL, display VARCHAR NOT NULL, controller_sha256 VARCHAR NOT NULL, curve VARCHAR NOT NULL,
        curve_sha256 VARCHAR NOT NULL, sensor_gain_v_per_mm FLOAT NOT NULL, band_low_hz FLOAT NOT NULL,
        band_high_hz FLOAT NOT NULL, started_utc VARCHAR NOT NULL, ended_utc VARCHAR,
        UNIQUE (session_id, position, attempt),
        CONSTRAINT run_state CHECK (state IN ('running', 'done', 'restarted', 'stopped')))""",
    """CREATE TABLE trial (
        id INTEGER NOT NULL PRIMARY KEY, run_id INTEGER NOT NULL REFERENCES run (id), number INTEGER NOT NULL,
        frequency_hz FLOAT, level_db_sl FLOAT, curve_level_db_re_1um FLOAT, correct_response VARCHAR NOT NULL,
        presented_utc VARCHAR NOT NULL, UNIQUE (run_id, number))""",
    """CREATE TABLE interval (
        id INTEGER NOT NULL PRIMARY KEY, trial_id INTEGER NOT NULL REFERENCES trial (id), position INTEGER NOT NULL,
        stimulus VARCHAR NOT NULL, commanded_db_sl FLOAT, measured_db_sl FLOAT, saturated BOOLEAN NOT NULL,
        UNIQUE (trial_id, position))""",
    """CREATE TABLE response (
        trial_id INTEGER NOT NULL PRIMARY KEY REFERENCES trial (id), response VARCHAR NOT NULL,
        correct BOOLEAN NOT NULL, client_shown_ms FLOAT, client_pressed_ms FLOAT,
        server_received_utc VARCHAR NOT NULL)""",
    """CREATE TABLE event (
        id INTEGER NOT NULL PRIMARY KEY, session_id INTEGER REFERENCES session (id), at_utc VARCHAR NOT NULL,
        kind VARCHAR NOT NULL, trials INTEGER, detail VARCHAR NOT NULL)""",
)

IDENTIFICATION = (
    """CREATE TABLE stimulus (
        id INTEGER NOT NULL PRIMARY KEY, study_id INTEGER NOT NULL REFERENCES study (id), label VARCHAR NOT NULL,
        source VARCHAR NOT NULL, sha256 VARCHAR NOT NULL, duration_s FLOAT NOT NULL, UNIQUE (study_id, label))""",
    """CREATE TABLE response_option (
        id INTEGER NOT NULL PRIMARY KEY, study_id INTEGER NOT NULL REFERENCES study (id), position INTEGER NOT NULL,
        label VARCHAR NOT NULL, "key" VARCHAR NOT NULL, UNIQUE (study_id, label), UNIQUE (study_id, "key"))""",
)

PROTOCOL_VERSIONS = (
    # Versions of protocols, subjects with several sessions, and the times at which stimuli were played.
    """CREATE TABLE protocol_version (
        id INTEGER NOT NULL PRIMARY KEY, study_id INTEGER NOT NULL REFERENCES study (id), number INTEGER NOT NULL,
        toml VARCHAR NOT NULL, sha256 VARCHAR NOT NULL, reason VARCHAR NOT NULL, tool_version VARCHAR NOT NULL,
        created_utc VARCHAR NOT NULL, UNIQUE (study_id, number), UNIQUE (study_id, sha256))""",
    """INSERT INTO protocol_version (study_id, number, toml, sha256, reason, tool_version, created_utc)
        SELECT id, 1, protocol_toml, protocol_sha256, '', tool_version, created_utc FROM study""",
    "CREATE TABLE study_next (id INTEGER NOT NULL PRIMARY KEY, name VARCHAR NOT NULL, created_utc VARCHAR NOT NULL)",
    "INSERT INTO study_next SELECT id, name, created_utc FROM study",
    "DROP TABLE study",
    "ALTER TABLE study_next RENAME TO study",
    """CREATE TABLE subject (
        id INTEGER NOT NULL PRIMARY KEY, study_id INTEGER NOT NULL REFERENCES study (id), number INTEGER NOT NULL,
        code VARCHAR NOT NULL, subject_group VARCHAR NOT NULL, participant_id VARCHAR, enrolled_utc VARCHAR NOT NULL,
        UNIQUE (study_id, number), UNIQUE (study_id, code), UNIQUE (study_id, participant_id))""",
    """INSERT INTO subject (id, study_id, number, code, subject_group, enrolled_utc)
        SELECT id, study_id, subject_number, subject_code, subject_group, created_utc FROM session""",
    """CREATE TABLE demographic (
        id INTEGER NOT NULL PRIMARY KEY, subject_id INTEGER NOT NULL REFERENCES subject (id), name VARCHAR NOT NULL,
        value VARCHAR NOT NULL, unit VARCHAR NOT NULL, UNIQUE (subject_id, name))""",
    """CREATE TABLE session_next (
        id INTEGER NOT NULL PRIMARY KEY, study_id INTEGER NOT NULL REFERENCES study (id),
        subject_id INTEGER NOT NULL REFERENCES subject (id), visit INTEGER NOT NULL,
        link_token VARCHAR NOT NULL UNIQUE, protocol_version_id INTEGER REFERENCES protocol_version (id),
        experimenter VARCHAR NOT NULL, site VARCHAR NOT NULL, surround VARCHAR NOT NULL, contact_area_mm2 FLOAT,
        skin_temperature_c FLOAT, preload_n FLOAT, masking_sound VARCHAR NOT NULL, masking_level_db_spl FLOAT,
        created_utc VARCHAR NOT NULL, consented_utc VARCHAR, consent_version VARCHAR, consent_sha256 VARCHAR,
        ended VARCHAR, ended_utc VARCHAR, UNIQUE (subject_id, visit),
        CONSTRAINT session_ended CHECK (ended IN ('declined', 'withdrawn', 'withdrawn-discard')))""",
    """INSERT INTO session_next (
            id, study_id, subject_id, visit, link_token, protocol_version_id, experimenter, site, surround,
            contact_area_mm2, skin_temperature_c, preload_n, masking_sound, masking_level_db_spl, created_utc,
            consented_utc)
        SELECT s.id, s.study_id, s.id, 1, s.link_token,
            CASE WHEN s.consented_utc IS NOT NULL OR EXISTS (SELECT 1 FROM run WHERE session_id = s.id) THEN v.id END,
            s.experimenter, s.site, s.surround, s.contact_area_mm2, s.skin_temperature_c, s.preload_n,
            s.masking_sound, s.masking_level_db_spl, s.created_utc, s.consented_utc
        FROM session AS s JOIN protocol_version AS v ON v.study_id = s.study_id""",
    "DROP TABLE session",
    "ALTER TABLE session_next RENAME TO session",
    "ALTER TABLE run ADD COLUMN protocol_version_id INTEGER REFERENCES protocol_version (id)",
    """UPDATE run SET protocol_version_id =
        (SELECT protocol_version_id FROM session WHERE session.id = run.session_id)""",
    "ALTER TABLE run ADD COLUMN respondent VARCHAR NOT NULL DEFAULT 'unknown'",
    "ALTER TABLE run ADD COLUMN rig_simulated BOOLEAN",
    """UPDATE run SET rig_simulated = 1
        WHERE rig IN ('simulated', 'in-process') OR rig LIKE 'emulated:%'""",
    "ALTER TABLE run ADD COLUMN shown VARCHAR NOT NULL DEFAULT ''",
    "ALTER TABLE run ADD COLUMN rig_rate_hz FLOAT",
    "ALTER TABLE run ADD COLUMN speed FLOAT",
    "ALTER TABLE trial ADD COLUMN ended_utc VARCHAR",
    "ALTER TABLE trial ADD COLUMN presentations INTEGER NOT NULL DEFAULT 1",
    "ALTER TABLE trial ADD COLUMN rig_tick INTEGER",
    "ALTER TABLE interval ADD COLUMN onset_s FLOAT",
    "ALTER TABLE interval ADD COLUMN duration_s FLOAT",
    "ALTER TABLE interval ADD COLUMN lamp_late_s FLOAT",
    "ALTER TABLE interval ADD COLUMN client_lit_ms FLOAT",
    "ALTER TABLE response ADD COLUMN server_after_end_s FLOAT",
)

CORRECTIONS = (
    # What an event changed, from what to what, and whose it was.
    "ALTER TABLE event ADD COLUMN subject_id INTEGER REFERENCES subject (id)",
    "ALTER TABLE event ADD COLUMN item VARCHAR",
    'ALTER TABLE event ADD COLUMN "before" VARCHAR',
    'ALTER TABLE event ADD COLUMN "after" VARCHAR',
)
