"""Void visits, runs and trials: kept with the reason, and left out of results and exports unless they are asked for."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, Table, delete, func, insert, select

from tactuator.errors import BadInput
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Change, Found, note, session_query


@dataclass(frozen=True)
class Part:
    """A visit of a subject, a run of it, or a trial of that run, by the numbers that exports have.

    visit: None where the run says it, or the subject has one alone.
    """

    visit: int | None = None
    run: int | None = None
    trial: int | None = None

    def __str__(self) -> str:
        named = {"trial": self.trial, "run": self.run, "visit": self.visit}
        return " of ".join(f"{name} {number}" for name, number in named.items() if number is not None)


def set_void(
    connection: Connection, study: int, code: str, part: Part, void: bool, reason: str, now: datetime, who: str
) -> Part:
    """Make a part of the subject of that code void, or valid again, and return it with its visit; an event has the
    reason.

    Raises BadInput without a reason, for a part that is not there or is so already, and while a run of it is in
    progress.
    """
    if not reason.strip():
        raise BadInput("no reason", "one in words, which is kept")
    visit, table, row = _place(connection, study, code, part)
    part = Part(visit.visit, part.run, part.trial)
    run = schema.run.c
    going = connection.execute(select(run.id).where(run.session_id == visit.id, run.state == "running")).scalar()
    if going is not None:
        raise BadInput(f"run {going} of visit {visit.visit} is in progress", "a visit whose runs have ended")
    mine = schema.void.c[f"{table.name}_id"]
    present = connection.execute(select(schema.void.c.id).where(mine == row)).first() is not None
    if present == void:
        raise BadInput(f"{part} of subject {code!r} is {'void already' if void else 'not void'}")
    if void:
        connection.execute(insert(schema.void).values({mine.name: row, "reason": reason.strip()}))
    else:
        connection.execute(delete(schema.void).where(mine == row))
    change = Change(str(part), *(("valid", "void") if void else ("void", "valid")))
    note(connection, visit.id, "void" if void else "restored", reason.strip(), now, who, None, visit.subject_id, change)
    return part


def _place(connection: Connection, study: int, code: str, part: Part) -> tuple[Found, Table, int]:
    """Return the visit of a part, and the table and the row that it is."""
    mine = (schema.session.c.study_id == study, schema.subject.c.code == code)
    visits = list(connection.execute(session_query().where(*mine).order_by(schema.session.c.visit)))
    if not visits:
        raise BadInput(f"subject {code!r} is not in the study", "one that is enrolled")
    if part.visit is not None:
        visits = [visit for visit in visits if visit.visit == part.visit]
        if not visits:
            raise BadInput(f"visit {part.visit} of subject {code!r} is not planned", "a visit of the subject")
    if part.run is None:
        if part.trial is not None:
            raise BadInput(f"trial {part.trial} without its run", "the run as well")
        if len(visits) > 1:
            raise BadInput(f"subject {code!r} has {len(visits)} visits", "the number of one, or of a run")
        return visits[0], schema.session, visits[0].id
    by_id = {visit.id: visit for visit in visits}
    of_run = connection.execute(select(schema.run.c.session_id).where(schema.run.c.id == part.run)).scalar()
    if of_run not in by_id:
        raise BadInput(f"run {part.run} is not of subject {code!r}", "a run of the subject, as exports number it")
    if part.trial is None:
        return by_id[of_run], schema.run, part.run
    trial = schema.trial.c
    row = connection.execute(select(trial.id).where(trial.run_id == part.run, trial.number == part.trial)).scalar()
    if row is None:
        raise BadInput(f"run {part.run} has no trial {part.trial}", "a trial that was answered, from 0")
    return by_id[of_run], schema.trial, row


def is_void(connection: Connection, session: int) -> bool:
    """Return whether the whole visit is void."""
    return connection.execute(select(schema.void.c.id).where(schema.void.c.session_id == session)).first() is not None


def void_parts(connection: Connection) -> dict[tuple[int, int | None, int | None], str]:
    """Return why a part is void, by its session, its run (None: the whole visit) and its trial (None: all of them)."""
    run, trial, void = schema.run, schema.trial, schema.void
    of = void.outerjoin(trial, void.c.trial_id == trial.c.id)
    of = of.outerjoin(run, run.c.id == func.coalesce(void.c.run_id, trial.c.run_id))
    session = func.coalesce(void.c.session_id, run.c.session_id)
    query = select(session, run.c.id, trial.c.number, void.c.reason).select_from(of).order_by(void.c.id)
    return {(visit, of_run, number): reason for visit, of_run, number, reason in connection.execute(query)}


def void_reasons(connection: Connection) -> dict[tuple[int, int | None], str]:
    """Return why a run (its id, None) or a trial (its run's id, its number) is void."""
    run, trial, void = schema.run.c, schema.trial.c, schema.void
    of_runs = select(run.id, void.c.reason).join(
        void, (void.c.run_id == run.id) | (void.c.session_id == run.session_id)
    )
    of_trials = select(trial.run_id, trial.number, void.c.reason).join(void)
    return {
        **{(row.id, None): row.reason for row in connection.execute(of_runs)},
        **{(row.run_id, row.number): row.reason for row in connection.execute(of_trials)},
    }
