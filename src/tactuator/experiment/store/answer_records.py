"""Reading and writing of trials and the responses to them: an answer is committed here."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, Integer, cast, func, insert, select

from tactuator.experiment.store import schema
from tactuator.experiment.store.cells import Found, stamp
from tactuator.experiment.trial.trial import IntervalRecord, Trial


def answers(connection: Connection, run: int) -> list[Found]:
    """Return every trial of a run with its response, in order."""
    query = (
        select(schema.trial, schema.response)
        .join(schema.response, schema.response.c.trial_id == schema.trial.c.id)
        .where(schema.trial.c.run_id == run)
        .order_by(schema.trial.c.number)
    )
    return list(connection.execute(query))


def tallies(connection: Connection, session: int) -> dict[int, tuple[int, int]]:
    """Return the numbers of answered and of right trials of a session's runs, by the run's row."""
    query = (
        select(schema.run.c.id, func.count(), func.sum(cast(schema.response.c.correct, Integer)))
        .select_from(schema.run.join(schema.trial).join(schema.response))
        .where(schema.run.c.session_id == session)
        .group_by(schema.run.c.id)
    )
    return {int(run): (int(count), int(right)) for run, count, right in connection.execute(query)}


def answer(connection: Connection, session: int, run: int, number: int) -> Found | None:
    """Return a trial of one of the session's runs with its response and the run's position, or None."""
    query = (
        select(schema.trial, schema.response, schema.run.c.position)
        .select_from(schema.response.join(schema.trial).join(schema.run))
        .where(schema.run.c.session_id == session, schema.trial.c.run_id == run, schema.trial.c.number == number)
    )
    return connection.execute(query).first()


@dataclass(frozen=True)
class Answer:
    """A response as it arrived.

    client_shown_ms, client_pressed_ms: by the client's own clock. client_lit_ms: when the client lit each interval's
    lamp, by the same clock. received_s: by the server's monotonic clock, where it was read as the response arrived.
    """

    response: str
    received: datetime
    client_shown_ms: float | None = None
    client_pressed_ms: float | None = None
    client_lit_ms: tuple[float | None, ...] = ()
    received_s: float | None = None


@dataclass(frozen=True)
class PlayedTrial:
    """A trial that has been played.

    frequency_hz, curve_level_db_re_1um: None where it is not at one frequency. presented, ended: its beginning and end
    by the server's clock (ended_s by its monotonic one). rig_tick: its beginning by the rig's clock. lasted_s: its
    duration there. presentations: how often it was played until then.
    """

    trial: Trial
    intervals: tuple[IntervalRecord, ...]
    presented: datetime
    frequency_hz: float | None = None
    curve_level_db_re_1um: float | None = None
    rig_tick: int | None = None
    lasted_s: float = 0.0
    ended: datetime | None = None
    ended_s: float | None = None
    presentations: int = 1


def save_answer(connection: Connection, run: int, played: PlayedTrial, answer: Answer) -> None:
    """Store the trial, its intervals and its response, all of them or, with the transaction, none."""
    trial, placement = played.trial, played.trial.placement
    row = {
        "run_id": run,
        "number": trial.number,
        "frequency_hz": played.frequency_hz,
        "level_db_sl": None if placement is None else placement.level_db_sl,
        "curve_level_db_re_1um": played.curve_level_db_re_1um,
        "correct_response": trial.correct,
        "presented_utc": stamp(played.presented),
        "ended_utc": None if played.ended is None else stamp(played.ended),
        "presentations": played.presentations,
        "rig_tick": played.rig_tick,
    }
    # the row goes beside the statement, not into it: the statement is then compiled once for all trials
    key = connection.execute(insert(schema.trial).returning(schema.trial.c.id), row).scalar_one()
    lit = [*answer.client_lit_ms, *([None] * len(played.intervals))]
    rows = [
        {"trial_id": key, "position": index, **vars(one), "client_lit_ms": lit[index]}
        for index, one in enumerate(played.intervals)
    ]
    if rows:
        connection.execute(insert(schema.interval), rows)
    values = {
        "trial_id": key,
        "response": answer.response,
        "correct": trial.judge(answer.response),
        "client_shown_ms": answer.client_shown_ms,
        "client_pressed_ms": answer.client_pressed_ms,
        "server_received_utc": stamp(answer.received),
        "server_after_end_s": _after_s(played, answer),
    }
    connection.execute(insert(schema.response), values)


def _after_s(played: PlayedTrial, answer: Answer) -> float | None:
    """Return the seconds from the end of the last interval to the response's arrival, by a monotonic clock."""
    if played.ended_s is None or answer.received_s is None:
        return None
    return answer.received_s - played.ended_s


def last_answer_utc(connection: Connection, session: int) -> str | None:
    """Return the arrival time of the session's last response, or None without one."""
    query = (
        select(func.max(schema.response.c.server_received_utc))
        .select_from(schema.response.join(schema.trial).join(schema.run))
        .where(schema.run.c.session_id == session)
    )
    return connection.execute(query).scalar()


def trial_count(connection: Connection, session: int) -> int:
    """Return the number of answered trials of the session, those of runs that were given up included."""
    query = (
        select(func.count())
        .select_from(schema.response.join(schema.trial).join(schema.run))
        .where(schema.run.c.session_id == session)
    )
    return int(connection.execute(query).scalar_one())
