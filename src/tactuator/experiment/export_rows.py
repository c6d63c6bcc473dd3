"""A store as tables of plain values, in the order of the dictionary, and as text; withdrawn data are left out."""

from __future__ import annotations

import csv
import io
import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import count
from math import isfinite
from pathlib import Path
from typing import Any, get_args

from sqlalchemy import ColumnElement, Connection, Row, Select, case, exists, func, or_, select

from tactuator.errors import BadInput
from tactuator.experiment.dictionary import (
    EVENT_COLUMNS,
    INTERVAL_COLUMNS,
    SUBJECT_COLUMNS,
    THRESHOLD_COLUMNS,
    TRIAL_COLUMNS,
    Meaning,
)
from tactuator.experiment.procedure.procedure import Playable
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.protocol.recognition import Paradigm
from tactuator.experiment.protocol.study import FORCED_CHOICE, StudyProtocol
from tactuator.experiment.result.thresholds import refit_prior, thresholds
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import CONSENT_NAMES
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import detection_runs

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Characters that spreadsheets take for the beginning of a formula."""


Value = str | int | float | None
TableRow = Mapping[str, Value]


@dataclass(frozen=True)
class ExportTable:
    """A table of an export: the meanings of its columns, and its rows as values by the columns' names."""

    columns: tuple[Meaning, ...]
    rows: tuple[TableRow, ...]

    def write(
        self, path: Path, separator: str = ",", missing: str = "", rows: Iterable[TableRow] | None = None
    ) -> None:
        """Write the table (or those rows) as separated values with a header; missing: of cells with nothing."""
        names = [column.name for column in self.columns]
        cells = ([cell(row[name], missing) for name in names] for row in (self.rows if rows is None else rows))
        path.write_text(lines([names, *cells], separator), encoding="utf-8")


@dataclass(frozen=True)
class Exported:
    """The tables of a store by name: trials, intervals, events, subjects, thresholds.

    settings: each version of each study's protocol, with its reason and time, by the name of its file.
    """

    tables: Mapping[str, ExportTable]
    settings: Mapping[str, Mapping[str, object]]


def cell(value: Value, missing: str = "") -> Value:
    """Return the value as a cell: words that a spreadsheet would execute begin with an apostrophe."""
    if value is None or value == "":
        return missing
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value


def lines(rows: Iterable[Sequence[object]], separator: str) -> str:
    """Return rows of separated values, each line ended by a line feed."""
    stream = io.StringIO()
    csv.writer(stream, delimiter=separator, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def write_json(path: Path, document: object) -> None:
    """Write the document as indented JSON."""
    path.write_text(json.dumps(document, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def label(text: str) -> str:
    """Return the text as a label in a file's name may be: letters and digits."""
    return re.sub(r"[^A-Za-z0-9]", "", text)


def task_name(row: TableRow) -> str:
    """Return the task of a trial, letters and digits: detection, recognition, or the kind that the protocol names."""
    paradigm = str(row["paradigm"])
    if paradigm in get_args(Paradigm):
        return "recognition"
    return "detection" if paradigm == FORCED_CHOICE else label(paradigm)


def task_names(rows: Sequence[TableRow]) -> list[str]:
    """Return the tasks of the trials, each once."""
    return sorted({task_name(row) for row in rows})


def study_names(data: Exported) -> str:
    """Return the names of the studies, joined."""
    return "; ".join(sorted({str(row["study"]) for row in data.tables["trials"].rows}))


@dataclass(frozen=True)
class Participant:
    """A subject of one study. label: the name in files, letters and digits, that no other participant has."""

    study: Value
    subject: Value
    label: str

    def has(self, row: TableRow) -> bool:
        """Tell whether a row of a table is of this participant."""
        return (row["study"], row["subject"]) == (self.study, self.subject)


def participants(data: Exported) -> list[Participant]:
    """Return the participants with trials, by study and code.

    A code that two studies of the store have, or two codes that a file system may take for one, are told apart: the
    name of the study stands before the code and, if that is not enough, a number follows.
    """
    each = sorted({(str(row["study"]), str(row["subject"])) for row in data.tables["trials"].rows})
    codes = Counter(label(subject).casefold() for _, subject in each)
    taken: set[str] = set()
    all_of_them = []
    for study, subject in each:
        name = label(subject) if codes[label(subject).casefold()] == 1 else label(study) + label(subject)
        numbered = (name if number == 1 else f"{name}n{number}" for number in count(1))
        free = next(name_tried for name_tried in numbered if name_tried.casefold() not in taken)
        taken.add(free.casefold())
        all_of_them.append(Participant(study, subject, free))
    return all_of_them


def description(data: Exported) -> str:
    """Return a description of the data in a sentence or two, which calls simulated data simulated."""
    trials = data.tables["trials"].rows
    text = f"Vibrotactile {' and '.join(task_names(trials))}, one row for each answered trial."
    simulated = {row["respondent"] for row in trials} & {"simulated", "script"}
    if simulated:
        text += " Simulated subjects answered; see the column respondent."
    elif any(row["rig_simulated"] == 1 for row in trials):
        text += " The display was simulated: nothing could be felt; see the columns rig_simulated and shown."
    return text


def exported(store: Store) -> Exported:
    """Read all of the store. Raises BadInput for a store without a response that may be used."""
    with store.read() as connection:
        tables = {"trials": _trials(connection)}
        if not tables["trials"].rows:
            raise BadInput(f"store {store.name} has no response", "one with at least one")
        tables |= {"intervals": _intervals(connection), "events": _events(connection)}
        tables["subjects"], settings = _subjects(connection), _settings(connection)
    tables["thresholds"] = _thresholds(store)
    return Exported(tables, settings)


_ORDER = (schema.study.c.id, schema.subject.c.number, schema.session.c.visit, schema.run.c.id, schema.trial.c.number)


def _trials(connection: Connection) -> ExportTable:
    names = {column.name for column in TRIAL_COLUMNS}
    taken = {"run", "trial", "ended_utc"}
    run, trial, response, session = schema.run, schema.trial, schema.response, schema.session
    # of a name that two tables have, the trial's: its frequency is not the run's where the procedure chooses
    of_its_own = {column.name: column for column in (*session.c, *run.c, *trial.c, *response.c)}
    query: Select[Any] = (
        select(
            *_identity(),
            session.c.ended.label("session_ended"),
            schema.protocol_version.c.number.label("protocol_version"),
            run.c.id.label("run"),
            run.c.state.label("run_state"),
            trial.c.number.label("trial"),
            trial.c.ended_utc.label("ended_utc"),
            response.c.server_received_utc.label("received_utc"),
            response.c.server_after_end_s.label("server_response_time"),
            schema.subject.c.subject_group,
            *(column for name, column in of_its_own.items() if name in names - taken - _IDENTITY_NAMES),
            trial.c.id.label("trial_key"),
            response.c.client_shown_ms,
            response.c.client_pressed_ms,
        )
        .select_from(
            schema.ANSWERED.outerjoin(
                schema.protocol_version, run.c.protocol_version_id == schema.protocol_version.c.id
            )
        )
        .where(schema.KEPT)
        .order_by(*_ORDER)
    )
    played = _played(connection)
    rows = []
    for row in connection.execute(query):
        values = dict(row._mapping)
        values["stimuli"], values["measured_db_sl"] = played.get(values["trial_key"], ("", None))
        shown, pressed = values["client_shown_ms"], values["client_pressed_ms"]
        values["subject_group"] = _group(values["subject_group"], values["respondent"])
        values["response_time"] = None if shown is None or pressed is None else (pressed - shown) / 1000.0
        rows.append(_plain(values, TRIAL_COLUMNS))
    return ExportTable(TRIAL_COLUMNS, tuple(rows))


_IDENTITY_NAMES = {"study", "subject", "visit"}


def _identity() -> tuple[Any, ...]:
    return (schema.study.c.name.label("study"), schema.subject.c.code.label("subject"), schema.session.c.visit)


def _played(connection: Connection) -> dict[int, tuple[str, float | None]]:
    """Return the labels of each trial's intervals, and the level at the sensor where something was commanded."""
    labels_of: dict[int, tuple[str, float | None]] = {}
    table = schema.interval
    for row in connection.execute(select(table).order_by(table.c.trial_id, table.c.position)):
        labels, measured = labels_of.get(row.trial_id, ("", None))
        labels = f"{labels}|{row.stimulus}" if labels else row.stimulus
        labels_of[row.trial_id] = (labels, measured if row.commanded_db_sl is None else row.measured_db_sl)
    return labels_of


def _intervals(connection: Connection) -> ExportTable:
    interval = schema.interval
    query = (
        select(
            *_identity(),
            schema.run.c.id.label("run"),
            schema.trial.c.number.label("trial"),
            (interval.c.position + 1).label("interval"),
            *(column for column in interval.c if column.name not in ("id", "trial_id", "position")),
            _told_simulated(_is_simulated()),
        )
        .select_from(schema.ANSWERED.join(interval, interval.c.trial_id == schema.trial.c.id))
        .where(schema.KEPT)
        .order_by(*_ORDER, interval.c.position)
    )
    return _table(connection.execute(query), INTERVAL_COLUMNS)


def _is_simulated() -> ColumnElement[bool]:
    return or_(schema.run.c.respondent.in_(("simulated", "script")), schema.run.c.rig_simulated)


def _told_simulated(condition: ColumnElement[bool]) -> ColumnElement[str]:
    return case((condition, "simulated"), else_="").label("simulated")


def _events(connection: Connection) -> ExportTable:
    event, session, subject, study = schema.event, schema.session, schema.subject, schema.study
    person = event.c.subject_id.not_in(_discarded())  # what changed is data of the subject
    kept = (event.c.kind != CONSENT_NAMES) & (event.c.item.is_(None) | person)
    names = {column.name for column in EVENT_COLUMNS} & set(event.c.keys())
    in_session = exists().where(schema.run.c.session_id == session.c.id, _is_simulated())
    query = (
        select(*_identity(), *(event.c[name] for name in sorted(names)), _told_simulated(in_session))
        .select_from(
            event.outerjoin(session, session.c.id == event.c.session_id)
            .outerjoin(subject, subject.c.id == func.coalesce(session.c.subject_id, event.c.subject_id))
            .outerjoin(study, study.c.id == subject.c.study_id)
        )
        .where(kept)
        .order_by(event.c.id)
    )
    return _table(connection.execute(query), EVENT_COLUMNS)


def _subjects(connection: Connection) -> ExportTable:
    facts: dict[int, dict[str, Value]] = {}
    meanings: dict[str, Meaning] = {}
    fact = schema.demographic
    for row in connection.execute(select(fact).where(fact.c.value.is_not(None)).order_by(fact.c.id)):
        facts.setdefault(row.subject_id, {})[row.name] = row.value
        meanings.setdefault(row.name, Meaning(row.name, "As the laboratory defines it", row.unit))
    for text in connection.execute(select(schema.protocol_version.c.toml)).scalars():
        for item in parse_protocol(text, StudyProtocol).demographic:
            meanings[item.name] = Meaning(item.name, item.label, item.unit)
    subject, run, session = schema.subject, schema.run, schema.session
    programs = (  # number of the subject's runs that a program answered
        select(func.count())
        .select_from(run.join(session, session.c.id == run.c.session_id))
        .where(session.c.subject_id == subject.c.id, run.c.respondent.in_(("simulated", "script")))
        .scalar_subquery()
    )
    query = (
        select(
            subject.c.id,
            schema.study.c.name.label("study"),
            subject.c.code.label("subject"),
            subject.c.subject_group,
            subject.c.participant_id.label("outside_id"),
            subject.c.enrolled_utc,
            programs.label("programs"),
        )
        .join(schema.study, schema.study.c.id == subject.c.study_id)
        .where(subject.c.id.not_in(_discarded()))
        .order_by(schema.study.c.id, subject.c.number)
    )
    columns = (*SUBJECT_COLUMNS, *meanings.values())
    rows = []
    for row in connection.execute(query):
        values = {**dict.fromkeys(meanings), **row._mapping, **facts.get(row.id, {})}
        values["subject_group"] = "simulated" if row.programs else row.subject_group
        rows.append(_plain(values, columns))
    return ExportTable(columns, tuple(rows))


def _discarded() -> Select[Any]:
    """Return a query of the subjects who left with all of their answers, so that nothing of them may be used."""
    session = schema.session
    kept = select(session.c.subject_id).where(schema.KEPT, session.c.consented_utc.is_not(None))
    return select(session.c.subject_id).where(session.c.ended == "withdrawn-discard", session.c.subject_id.not_in(kept))


def _thresholds(store: Store) -> ExportTable:
    try:
        runs = detection_runs(store)
    except BadInput:
        return ExportTable(THRESHOLD_COLUMNS, ())
    with store.read() as connection:
        names = {row.id: row.name for row in connection.execute(select(schema.study))}
        numbers = {row.id: row.number for row in connection.execute(select(schema.protocol_version))}
    about = {
        run.run.id: {
            "study": names[run.session.study_id],
            "visit": run.session.visit,
            "protocol_version": numbers[run.run.protocol_version_id],
            "respondent": run.run.respondent,
            "rig_simulated": run.run.rig_simulated,
            "shown": run.run.shown,
        }
        for run in runs
    }
    rows = []
    for threshold in thresholds(runs):
        values = {**asdict(threshold), **about[threshold.run], "flags": "|".join(threshold.flags)}
        values["group"] = _group(threshold.group, str(values["respondent"]))
        rows.append(_plain(values, THRESHOLD_COLUMNS))
    return ExportTable(THRESHOLD_COLUMNS, tuple(rows))


def _group(group: str, respondent: str) -> str:
    """Return the group of a row: `simulated` where a program answered, whatever the protocol says."""
    return "simulated" if respondent in ("simulated", "script") else group


def _settings(connection: Connection) -> dict[str, dict[str, object]]:
    version, study = schema.protocol_version, schema.study
    query = (
        select(version, study.c.name.label("study"))
        .join(study, study.c.id == version.c.study_id)
        .order_by(version.c.study_id, version.c.number)
    )
    return {
        f"protocol-{row.study_id}-{row.number}": {
            "study": row.study,
            "version": row.number,
            "reason": row.reason,
            "sha256": row.sha256,
            "tool_version": row.tool_version,
            "created_utc": row.created_utc,
            "protocol": json.loads(json.dumps(tomllib.loads(row.toml), default=str)),
            **_refit(row.toml),
        }
        for row in connection.execute(query)
    }


def _refit(text: str) -> dict[str, object]:
    """Return the settings of the refit under the key `refit`, where the protocol's runs are refitted one by one."""
    protocol = parse_protocol(text, StudyProtocol)
    if not isinstance(protocol, Protocol) or protocol.procedure.chooses_frequency:
        return {}
    procedure = protocol.fresh_run(Playable())
    return {"refit": refit_prior(protocol.paradigm.guess, procedure).settings()}


def _table(rows: Iterable[Row[Any]], columns: tuple[Meaning, ...]) -> ExportTable:
    return ExportTable(columns, tuple(_plain(dict(row._mapping), columns) for row in rows))


def _plain(values: Mapping[str, object], columns: tuple[Meaning, ...]) -> TableRow:
    return {column.name: _value(values[column.name]) for column in columns}


def _value(value: object) -> Value:
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, float) and not isfinite(value):
        return None
    assert value is None or isinstance(value, str | int | float)
    return value
