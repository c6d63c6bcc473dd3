"""Reading and writing of runs, the apparatus of each, and events of a session."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, func, insert, select, update

from tactuator.experiment.protocol.plan import PlannedRun
from tactuator.experiment.store import schema
from tactuator.experiment.store.cells import Found, stamp


@dataclass(frozen=True)
class ApparatusRecord:
    """The apparatus that plays the stimuli, as it is stored with every run.

    rig_simulated: True where nothing can be felt. speed: of presentation, 1 being real time, None as fast as the rig
    can.
    """

    rig: str
    display: str
    controller_sha256: str
    curve: str
    curve_sha256: str
    sensor_gain_v_per_mm: float
    band_low_hz: float
    band_high_hz: float
    rig_simulated: bool = False
    rig_rate_hz: float | None = None
    speed: float | None = None


@dataclass(frozen=True)
class Sitting:
    """The respondent of a sitting and what of the stimuli they can see or hear, as stored with every run.

    respondent: person, simulated or script. shown: empty, or "seen" or "seen and heard" in a demonstration.
    """

    respondent: str = "person"
    shown: str = ""


def latest_runs(connection: Connection, session: int) -> list[Found]:
    """Return the last attempt at every position, in order."""
    query = (
        select(schema.run)
        .where(schema.run.c.session_id == session)
        .order_by(schema.run.c.position, schema.run.c.attempt)
    )
    return list({row.position: row for row in connection.execute(query)}.values())


def attempts(connection: Connection, session: int, position: int) -> int:
    """Return the number of attempts at a planned run."""
    query = select(func.count()).where(schema.run.c.session_id == session, schema.run.c.position == position)
    return int(connection.execute(query).scalar_one())


def begin_run(
    connection: Connection,
    session: int,
    planned: PlannedRun,
    attempt: int,
    apparatus: ApparatusRecord,
    sitting: Sitting,
    version: int,
    now: datetime,
) -> int:
    """Store a new attempt at a planned run under that version of the protocol, and return its id."""
    row = {
        "session_id": session,
        "position": planned.position,
        "attempt": attempt,
        "state": "running",
        "practice": planned.practice,
        "paradigm": planned.paradigm,
        "procedure": planned.procedure,
        "finger": planned.finger,
        "frequency_hz": planned.frequency_hz,
        "started_utc": stamp(now),
        "protocol_version_id": version,
        **vars(apparatus),
        **vars(sitting),
    }
    return int(connection.execute(insert(schema.run).values(row).returning(schema.run.c.id)).scalar_one())


def end_run(connection: Connection, run: int, state: str, now: datetime) -> None:
    """Store that a run is done, restarted or stopped."""
    connection.execute(update(schema.run).where(schema.run.c.id == run).values(state=state, ended_utc=stamp(now)))


@dataclass(frozen=True)
class Change:
    """A value that was replaced; item: its name, as the exports' columns have it. None: nothing stood, or stands."""

    item: str
    before: str | None
    after: str | None


def note(
    connection: Connection,
    session: int | None,
    kind: str,
    detail: str,
    now: datetime,
    trials: int | None = None,
    subject: int | None = None,
    change: Change | None = None,
) -> None:
    """Store an event of that kind; subject: whose it is, where it is of no session; change: what it replaced."""
    row = {"session_id": session, "at_utc": stamp(now), "kind": kind, "detail": detail, "trials": trials}
    row |= {"subject_id": subject, **(vars(change) if change is not None else {})}
    connection.execute(insert(schema.event).values(row))


def last_break(connection: Connection, session: int) -> int:
    """Return the number of trials that the session had when its last break ended; 0 if there was none."""
    query = select(func.max(schema.event.c.trials)).where(
        schema.event.c.session_id == session, schema.event.c.kind == "break"
    )
    return int(connection.execute(query).scalar() or 0)
