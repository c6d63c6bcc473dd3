"""Sessions: what is acknowledged is there, and an interrupted session goes on where it was."""

import sqlite3

import pytest
from sqlalchemy import select

from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.session.detection_task import DetectionTask
from tactuator.experiment.store import records, schema
from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import (
    PROTOCOL,
    answer_one,
    apparatus,
    begin,
    everything,
    nobody,
    response_of,
    rows_of,
)


def stored(store):
    run, trial = schema.run.c, schema.trial.c
    columns = (run.position, run.attempt, trial.number, trial.level_db_sl, schema.response.c.response)
    return [tuple(row) for row in rows_of(store, select(*columns).select_from(schema.ANSWERED).order_by(trial.id))]


def test_session__interrupted_over_and_over__is_the_undisturbed_one(tmp_path, clock) -> None:
    whole, broken = Store(tmp_path / "whole.db"), tmp_path / "broken.db"
    text = PROTOCOL.replace("[30, 90, 210]", "[30, 90]")
    everything(begin(whole, clock, text), clock)
    while True:
        store = Store(broken)
        presented = begin(store, clock, text)
        if presented.session.stage == "done":
            break
        for _ in range(4):
            if presented.session.stage == "break":
                presented.session.end_break()
            if presented.session.stage == "trial":
                presented.present(nobody)  # played, never answered: presented again
                answer_one(presented, clock)
        store.close()
    assert stored(store) == stored(whole)
    assert len({row[:3] for row in stored(store)}) == len(stored(store))
    store.close()
    whole.close()


def test_trial__stored__has_levels_labels_times_and_apparatus(store, clock) -> None:
    presented = begin(store, clock)
    answer_one(presented, clock)
    (trial,), (run,), (response,) = (
        rows_of(store, select(table)) for table in (schema.trial, schema.run, schema.response)
    )
    intervals = rows_of(store, select(schema.interval).order_by(schema.interval.c.position))
    with store.read() as connection:
        session = records.session(connection, presented.session.id)
    (tone,) = (one for one in intervals if one.stimulus == "tone")
    assert str(tone.position + 1) == trial.correct_response
    assert tone.commanded_db_sl == trial.level_db_sl == 30.0
    assert tone.measured_db_sl == pytest.approx(30.0, abs=1.5)
    assert all(one.commanded_db_sl is None for one in intervals if one.stimulus == "blank")
    assert (response.client_shown_ms, response.client_pressed_ms) == (10.0, 460.0)
    assert response.server_received_utc.startswith("2026-03-01T12:00:01")
    assert len(run.controller_sha256) == 64
    assert (run.practice, run.rig, run.curve) == (True, "simulated", "bolanowski-1988")
    assert (session.contact_area_mm2, session.skin_temperature_c, session.masking_sound) == (78.5, 31.0, "pink")
    assert (session.subject_group, session.experimenter) == ("hearing", "EX")


@pytest.mark.parametrize(("gap_s", "attempts"), [(599.0, [0]), (700.0, [0, 1])])
def test_resume__gap_longer_than_allowed__restarts_the_run_and_keeps_the_old(store, gap_s, attempts, clock) -> None:
    begin(store, clock, trials=5)
    clock.jump(gap_s)  # the machine was off: the monotonic clock knows nothing of it
    answer_one(begin(store, clock), clock)
    runs = rows_of(store, select(schema.run).where(schema.run.c.position == 1).order_by(schema.run.c.attempt))
    assert [run.attempt for run in runs] == attempts
    assert [run.state for run in runs] == ["restarted", "running"][-len(attempts) :]


def test_pause__by_the_monotonic_clock__restarts_and_a_clock_set_back_is_noted_and_loses_nothing(store, clock) -> None:
    presented = begin(store, clock, trials=4)
    clock.jump(-3600.0)
    assert answer_one(presented, clock) == (1, 2)
    clock.jump(-7200.0)
    assert answer_one(begin(store, clock), clock) == (1, 3)
    assert [row.kind for row in rows_of(store, select(schema.event))] == ["clock-jump"]
    presented = begin(store, clock)
    clock.passed_s += 601.0
    assert answer_one(presented, clock) == (1, 0)


def test_answer__disk_full__is_not_acknowledged_and_may_come_again(store, clock) -> None:
    presented = begin(store, clock, PROTOCOL.replace("reversals = 6", "reversals = 40"))  # enough trials to fill a page
    with store.engine.connect() as connection:
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar_one()
        connection.exec_driver_sql(f"PRAGMA max_page_count = {pages}")  # of the pooled connection: no page more
    acknowledged = []
    with pytest.raises(StoreFault, match="full"):
        everything(presented, clock, lambda *at: acknowledged.append(answer_one(*at)))
    assert [(row[0], row[2]) for row in stored(store)] == acknowledged
    if presented.pending is not None:
        stands = presented.pending[0]
        with store.engine.connect() as connection:
            connection.exec_driver_sql("PRAGMA max_page_count = 1000000")
        answer = records.Answer(response_of(stands.trial), clock.utc())
        assert presented.answer(answer).number == stands.trial.number
        assert len(stored(store)) == len(acknowledged) + 1


def test_answer__database_locked__is_told_and_may_come_again(store, clock) -> None:
    presented = begin(store, clock)
    presented.present(nobody)
    with store.engine.connect() as connection:
        connection.exec_driver_sql("PRAGMA busy_timeout = 1")
    other = sqlite3.connect(store.path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    answer = records.Answer("1", clock.utc())
    with pytest.raises(StoreFault, match="locked"):
        presented.answer(answer)
    other.execute("ROLLBACK")
    other.close()
    assert presented.answer(answer).number == 0
    assert len(stored(store)) == 1


def test_answer__amiss_or_sent_again__is_refused_or_acknowledged_again_and_stored_once(store, clock) -> None:
    presented, other = begin(store, clock), begin(store, clock, subject=1)
    with pytest.raises(BadInput, match="no trial waits"):
        presented.answer(records.Answer("1", clock.utc()))
    run = presented.present(nobody).run
    for response in ("0", "4", "", "left"):
        with pytest.raises(BadInput, match="allowed: 1, 2, 3"):
            presented.answer(records.Answer(response, clock.utc()))
    assert stored(store) == []
    first = presented.answer(records.Answer("1", clock.utc()))
    again = presented.session.already(run, 0)
    assert again is not None
    assert (again.correct, again.again) == (first.correct, True)
    assert presented.session.already(run, 1) is other.session.already(run, 0) is None
    assert len(stored(store)) == 1


def test_break__after_its_trials__waits_until_it_is_ended_and_is_remembered(store, clock) -> None:
    presented = begin(store, clock, trials=20)
    assert presented.session.stage == "break"
    with pytest.raises(BadInput, match="'break'"):
        presented.present(nobody)
    presented.session.end_break()
    assert begin(store, clock).session.stage == "trial"


def test_give_up_run__goes_on_with_the_next_and_marks_it(store, clock) -> None:
    presented = begin(store, clock, trials=4)
    presented.give_up_run()
    assert answer_one(presented, clock) == (2, 0)
    assert rows_of(store, select(schema.run.c.state)) == [("done",), ("stopped",), ("running",)]
    with pytest.raises(BadInput, match="no trial waits"):
        presented.answer(records.Answer("1", clock.utc()))


def test_replay__store_changed_by_hand__is_refused(store, clock) -> None:
    begin(store, clock, trials=6)
    with store.begin() as connection:
        connection.execute(schema.trial.update().where(schema.trial.c.number == 2).values(level_db_sl=3.0))
    with pytest.raises(BadInput, match="does not replay"):
        begin(store, clock)


@pytest.mark.parametrize(("old", "new", "message"), [("210]", "500]", "500 Hz"), ('"index"', '"ring"', "'ring'")])
def test_apparatus__what_it_cannot_play__is_refused(old, new, message) -> None:
    with pytest.raises(BadInput, match=message):
        DetectionTask(parse_protocol(PROTOCOL.replace(old, new)), apparatus())
