"""The verbs `experiment enrol` and `experiment correct`: subjects, visits and their data, without a server or a rig."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import get_args

from pydantic import ValidationError
from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.cli.experiment.observers import pairs
from tactuator.errors import BadInput
from tactuator.experiment.protocol.study import Group, SubjectPart
from tactuator.experiment.session.studies import Correction, add_visit, books_of, enrol, fresh_token
from tactuator.experiment.session.studies import correct as correct_subject
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.store import records
from tactuator.experiment.store.store import Store, sessions_of


def run(
    code: str,
    store: Path,
    study: str | None,
    group: str | None,
    participant_id: str | None,
    skin_temperature_c: float | None,
    fact: list[str] | None,
    visit: bool,
    as_json: bool,
) -> None:
    """Add a subject to a study of the store, or a further visit of one, and show the links of all visits."""
    given = [group, participant_id, skin_temperature_c, fact or None]
    if visit and any(one is not None for one in given):
        raise BadInput("--visit with facts of a new subject", "--visit alone, for a subject who is enrolled")
    database = Store(store, must_exist=True)
    try:
        with sessions_of(store), database.begin() as connection:
            books = books_of(connection, study, fresh_token, SystemClock().utc())
            if visit:
                add_visit(connection, books, code)
            else:
                enrol(connection, books, _part(code, group, participant_id, skin_temperature_c, fact or []))
            rows = [row for row in records.sessions(connection, books.study) if row.subject_code == code]
    finally:
        database.close()
    visits = [{"visit": row.visit, "path": f"/s/{row.link_token}"} for row in rows]
    table = Table("visit", "link, after the server's address", title=f"{books.protocol.study.name}: {code}")
    for one in visits:
        table.add_row(str(one["visit"]), str(one["path"]))
    answer({"study": books.protocol.study.name, "subject": code, "visits": visits}, as_json, table)


def correct(
    code: str,
    store: Path,
    reason: str,
    study: str | None,
    group: str | None,
    participant_id: str | None,
    visit: int | None,
    skin_temperature_c: float | None,
    preload_n: float | None,
    fact: list[str] | None,
    as_json: bool,
) -> None:
    """Write correct data of a subject or a visit; what stood there stays in the store and in exports."""
    part = _part(code, group, participant_id, skin_temperature_c, [])
    if preload_n is not None and not 0.0 <= preload_n < float("inf"):
        raise BadInput(f"subject: preload_n is {preload_n:g}", "a number of 0 or more")
    facts = dict(pairs("--fact", "NAME=VALUE", fact or [], empty=True))
    values = (None if group is None else part.group, part.participant_id, facts)
    correction = Correction(*values, visit, part.skin_temperature_c, preload_n)
    database = Store(store, must_exist=True)
    try:
        with sessions_of(store), database.begin() as connection:
            books = books_of(connection, study, fresh_token, SystemClock().utc())
            changes = correct_subject(connection, books, code, correction, reason)
    finally:
        database.close()
    table = Table("item", "before", "after", title=f"{books.protocol.study.name}: {code}")
    for one in changes:
        table.add_row(one.item, one.before or "-", one.after or "-")
    told = {"study": books.protocol.study.name, "subject": code, "changes": [asdict(one) for one in changes]}
    answer(told, as_json, table)


def _part(
    code: str, group: str | None, participant_id: str | None, skin_temperature_c: float | None, facts: list[str]
) -> SubjectPart:
    """Return the subject as a protocol file would have it. Raises BadInput for what one may not hold."""
    document = {
        "code": code,
        "group": group or "unknown",
        "participant_id": participant_id,
        "skin_temperature_c": skin_temperature_c,
        "demographics": dict(pairs("--fact", "NAME=VALUE", facts)),
    }
    try:
        return SubjectPart.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(one) for one in first["loc"])
        allowed = ", ".join(get_args(Group)) if name == "group" else first["msg"]
        raise BadInput(f"subject: {name} is {first['input']!r}", f"{allowed}") from None
