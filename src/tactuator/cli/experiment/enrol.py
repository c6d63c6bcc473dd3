"""The verb `experiment enrol`: a subject, or a further visit, without a server and without a rig."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from pydantic import ValidationError
from rich.table import Table

from tactuator.cli.answer import answer
from tactuator.cli.experiment.observers import pairs
from tactuator.errors import BadInput
from tactuator.experiment.protocol.study import Group, SubjectPart
from tactuator.experiment.session.clock import SystemClock
from tactuator.experiment.session.enrolment import add_visit, books_of, enrol, fresh_token
from tactuator.experiment.store import study_records
from tactuator.experiment.store.lock import sessions_of
from tactuator.experiment.store.store import Store


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
        raise BadInput("--visit with facts of a new subject; allowed: --visit alone, for a subject who is enrolled")
    database = Store(store, must_exist=True)
    try:
        with sessions_of(store), database.begin() as connection:
            books = books_of(connection, study, fresh_token, SystemClock().utc())
            if visit:
                add_visit(connection, books, code)
            else:
                enrol(connection, books, _part(code, group, participant_id, skin_temperature_c, fact or []))
            rows = [row for row in study_records.sessions(connection, books.study) if row.subject_code == code]
    finally:
        database.close()
    visits = [{"visit": row.visit, "path": f"/s/{row.link_token}"} for row in rows]
    table = Table("visit", "link, after the server's address", title=f"{books.protocol.study.name}: {code}")
    for one in visits:
        table.add_row(str(one["visit"]), str(one["path"]))
    answer({"study": books.protocol.study.name, "subject": code, "visits": visits}, as_json, table)


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
        raise BadInput(f"subject: {name} is {first['input']!r}; allowed: {allowed}") from None
