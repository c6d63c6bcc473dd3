"""Sessions: what is acknowledged is there, what was cut off goes on; yes and no; studies that are amended."""

import gc
import json
from contextlib import closing

import numpy as np
import psutil
import pytest
from sqlalchemy import select

from tactuator.errors import BadInput, StoreFault
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.protocol.study import SubjectPart
from tactuator.experiment.result.played import attention
from tactuator.experiment.result.thresholds import thresholds
from tactuator.experiment.session.respondent import Respondent, run_session
from tactuator.experiment.session.studies import Correction, open_session, open_study
from tactuator.experiment.session.task import Apparatus
from tactuator.experiment.session.tone_task import DetectionTask
from tactuator.experiment.store import records, schema
from tactuator.experiment.store.records import Answer
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import detection_runs
from tactuator.experiment.trial import BLANK
from tactuator.rig.board.stream import StreamDry
from tactuator.rig.simulated import SimulatedRig
from tactuator.rig.sound.stream import SoundGap
from tests.experiment.session.apparatuses import (
    PROTOCOL,
    ObedientClock,
    answer_one,
    apparatus,
    begin,
    everything,
    nobody,
    opened_study,
    response_of,
    rows_of,
    token,
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
        if presented.stage == "done":
            break
        for _ in range(4):
            if presented.stage == "break":
                presented.end_break()
            if presented.stage == "trial":
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
        session = records.session(connection, presented.id)
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


def test_pause__by_the_monotonic_clock__restarts_and_a_clock_set_back_is_noted(store, clock) -> None:
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


def test_answer__amiss_or_sent_again__is_refused_or_stored_once(store, clock) -> None:
    presented, other = begin(store, clock), begin(store, clock, subject=1)
    with pytest.raises(BadInput, match="no trial waits"):
        presented.answer(records.Answer("1", clock.utc()))
    run = presented.present(nobody).run
    for response in ("0", "4", "", "left"):
        with pytest.raises(BadInput, match="1, 2, 3"):
            presented.answer(records.Answer(response, clock.utc()))
    assert stored(store) == []
    first = presented.answer(records.Answer("1", clock.utc()))
    again = presented.already(run, 0)
    assert again is not None
    assert (again.correct, again.again) == (first.correct, True)
    assert presented.already(run, 1) is other.already(run, 0) is None
    assert len(stored(store)) == 1


def test_break__after_its_trials__waits_until_it_is_ended_and_is_remembered(store, clock) -> None:
    presented = begin(store, clock, trials=20)
    assert presented.stage == "break"
    with pytest.raises(BadInput, match="'break'"):
        presented.present(nobody)
    presented.end_break()
    assert begin(store, clock).stage == "trial"


def test_give_up_run__goes_on_with_the_next_and_marks_it(store, clock) -> None:
    presented = begin(store, clock, trials=4)
    presented.stop_run()
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
        DetectionTask(parse_protocol(PROTOCOL.replace(old, new), Protocol), apparatus())


@pytest.fixture
def presented(store, clock):
    return begin(store, clock)


DRY = StreamDry("the stream ran dry 240 samples after its beginning", "a faster host", 12)
GAP = SoundGap("the sound card reported a gap 0.060 s after the beginning")


def dry(rig, times, monkeypatch, error=DRY):
    """Let the rig's stream run dry in the middle of a trial, so many times."""
    stream, left = rig.stream, [times]

    def drying(blocks):
        for count, trace in enumerate(stream(blocks)):
            if count == 3 and left[0]:
                left[0] -= 1
                raise error
            yield trace

    monkeypatch.setattr(rig, "stream", drying)


@pytest.mark.parametrize(
    ("times", "error", "words"), [(2, DRY, "the stream ran dry 240 samples"), (1, GAP, "the sound card reported a gap")]
)
def test_present__timing_missed__is_noted_and_the_trial_played_again(presented, monkeypatch, times, error, words):
    dry(presented.task.apparatus.rig, times, monkeypatch, error)
    following = presented.present(nobody)
    noted = rows_of(presented.store, select(schema.event))
    assert [event.kind for event in noted] == ["timing-missed"] * times
    assert f"trial 0: {words}" in noted[0].detail
    presented.answer(Answer(following.trial.correct, presented.clock.utc()))
    (row,) = rows_of(presented.store, select(schema.trial))
    onsets = [onset for (onset,) in rows_of(presented.store, select(schema.interval.c.onset_s))]
    assert row.presentations == times + 1
    length_s = round(2 / 30 * 4000) / 4000  # two periods of 30 Hz, in whole samples
    assert np.allclose(onsets, 0.01 + (length_s + 0.01) * np.arange(3), atol=1e-9)
    dry(presented.task.apparatus.rig, 9, monkeypatch)
    with pytest.raises(StreamDry):  # again and again: the rig's fault
        presented.present(nobody)
    assert len(rows_of(presented.store, select(schema.event))) == times + 3
    with pytest.raises(BadInput, match="no trial waits"):
        presented.answer(Answer("1", presented.clock.utc()))


def test_answer__earlier_than_its_trial_by_either_clock__is_refused(presented) -> None:
    clock = presented.clock
    following = presented.present(nobody)
    with pytest.raises(BadInput, match=r"0.500 s before the interval ended"):
        presented.answer(Answer("1", clock.utc(), received_s=clock.monotonic_s() - 0.5))
    with pytest.raises(BadInput, match="50 ms before the question"):
        presented.answer(Answer("1", clock.utc(), 100.0, 50.0))
    assert presented.answer(Answer("1", clock.utc(), 100.0, 100.0, (), clock.monotonic_s())).number == 0
    assert following.trial.number == 0


YES_NO = (
    PROTOCOL.replace("steps_db = [4, 2]", "steps_db = [4, 2]\ndown = 1\nup = 1")
    .replace("reversals = 6\naveraged = 4", "reversals = 25\naveraged = 21\naverage = 'mid-runs'")
    .replace("[conditions]", "[paradigm]\nintervals = 1\n[catch]\nblank_share = 0.2\n[conditions]")
    .replace("[30, 90, 210]", "[90]")
    .replace("practice_trials = 2", "practice_trials = 0")
)
THRESHOLD_DB_SL = 7.0


class Person(Respondent):
    """Feels a level with the probability of a logistic function, and nothing at all `alarms` of the time."""

    def __init__(self, alarms: float) -> None:
        self.rng, self.alarms = np.random.default_rng(3), alarms

    def respond(self, trial) -> str:
        blank = BLANK in trial.stimuli
        felt = 0.0 if blank else 1.0 / (1.0 + np.exp(-(trial.placement.level_db_sl - THRESHOLD_DB_SL) / 1.2))
        return "1" if self.rng.random() < max(felt, self.alarms) else "0"


def result(store, clock, alarms):
    session = open_session(opened_study(store, clock, YES_NO), "S1")
    session.give_consent()
    run_session(session, Person(alarms), rest=clock.wait)
    runs = detection_runs(store)
    return thresholds(runs)[0], attention(runs[0])


def test_yes_no__of_a_careful_person__finds_the_level_felt_half_of_the_time(store, clock) -> None:
    one, flags = result(store, clock, 0.0)
    assert one.point == pytest.approx(0.5, abs=1e-3)
    assert one.own_db_sl == pytest.approx(THRESHOLD_DB_SL, abs=1.0)
    assert one.refit_low_db_sl < THRESHOLD_DB_SL < one.refit_high_db_sl
    assert flags == ()


def test_yes_no__of_a_person_who_says_yes_to_nothing__is_flagged(store, clock) -> None:
    assert result(store, clock, 0.5)[1] == ("attention",)
    protocol = parse_protocol(YES_NO, Protocol)
    assert (protocol.paradigm.responses, protocol.paradigm.guess) == (("1", "0"), 0.02)


PARTS, STREAM_S, BLOCK = 100, 720.0, 200


@pytest.mark.soak
def test_day__of_three_channels__memory_and_state_are_flat(tmp_path, controller) -> None:
    rig, clock, rng = SimulatedRig(controller.display, 7), ObedientClock(), np.random.default_rng(3)
    rig.load(controller)
    finger = json.dumps(controller.display.channels[0].finger)
    text = PROTOCOL[: PROTOCOL.index("[[subject]]")].replace('"index"', finger)
    text += "".join(f'[[subject]]\ncode = "D{part}"\n' for part in range(PARTS))
    time_s = np.arange(round(rig.rate_hz))[:, None] / rig.rate_hz
    tone = np.repeat(100.0 * np.sin(2.0 * np.pi * 90.0 * time_s), len(rig.channels), axis=1)
    memory_mb, objects, levels_db = [], [], []
    with closing(Store(tmp_path / "lab.db")) as store:
        task = DetectionTask(parse_protocol(text, Protocol), Apparatus(rig, controller, "simulated"))
        study = open_study(store, task, text, clock, token, None)
        for part in range(PARTS):
            loud = rng.choice([30.0, 30.0, 0.0], round(STREAM_S * rig.rate_hz / BLOCK))  # as speech, with pauses
            for _ in rig.stream(level * rng.standard_normal((BLOCK, len(rig.channels))) for level in loud):
                pass
            session = open_session(study, f"D{part}")
            session.give_consent()
            everything(session, clock)
            rig.rest()
            levels_db.append(20.0 * np.log10(np.std(rig.play(tone).position_v[len(tone) // 2 :], axis=0)))
            rig.rest()
            gc.collect()
            memory_mb.append(psutil.Process().memory_info().rss / 1e6)
            objects.append(len(gc.get_objects()))
    assert memory_mb[-1] - memory_mb[PARTS // 10] < 10.0
    assert objects[-1] - objects[PARTS // 10] < 2000
    assert np.ptp(levels_db, axis=0).max() < 0.1


FIRST = PROTOCOL.replace('[[subject]]\ncode = "S1"', '[[subject]]\ncode = "S0"\n[[subject]]\ncode = "S1"', 1)
OTHER = PROTOCOL.replace("[30, 90, 210]", "[33, 90, 150, 210]")
ASKS = PROTOCOL.replace("[[subject]]\n", '[[subject]]\ndemographics = { hand = "right" }\n') + (
    '[[demographic]]\nname = "age"\nlabel = "Age"\nkind = "number"\nunit = "year"\nlow = 18\nhigh = 99\n'
    '[[demographic]]\nname = "hand"\nlabel = "Hand"\nkind = "choice"\nchoices = ["left", "right"]\nrequired = true\n'
)


RUNS = schema.run.join(schema.session).join(schema.subject, schema.subject.c.id == schema.session.c.subject_id)


def all_of(store, subject):
    tables = RUNS.outerjoin(schema.trial).outerjoin(schema.response)
    of_subject = schema.subject.c.code == subject
    people = select(schema.subject, schema.session).join_from(schema.subject, schema.session).where(of_subject)
    answers = select(schema.run, schema.trial, schema.response).select_from(tables).where(of_subject)
    return rows_of(store, people), rows_of(store, answers)


def versions_of_runs(store, subject):
    tables = RUNS.join(schema.protocol_version, schema.protocol_version.c.id == schema.run.c.protocol_version_id)
    query = select(schema.protocol_version.c.number, schema.run.c.frequency_hz).select_from(tables)
    return [
        tuple(row) for row in rows_of(store, query.where(schema.subject.c.code == subject).order_by(schema.run.c.id))
    ]


def orders(study):
    return {
        (row.subject_code, row.visit): [(run.finger, run.frequency_hz) for run in study.session(row).runs]
        for row in study.sessions()
    }


def test_study__subject_added_to_the_file__leaves_the_others_as_they_are(store, clock) -> None:
    presented = begin(store, clock, trials=5)
    study, same = opened_study(store, clock), opened_study(store, clock)
    assert (study.id, study.version, len(same.sessions())) == (same.id, same.version, 2)
    before, order = all_of(store, "S1"), orders(study)
    study = opened_study(store, clock, FIRST)
    assert all_of(store, "S1") == before
    after = orders(study)
    assert {key: after[key] for key in order} == order
    assert after["S0", 1] not in (order["S1", 1], order["S2", 1])
    links = [(row.subject_code, row.link_token) for row in study.sessions()]
    assert sorted(links) == [(code, f"token-{code}") for code in ("S0", "S1", "S2")]
    again = begin(store, clock, FIRST, subject=1)
    assert again.next_trial().trial == presented.next_trial().trial


def test_study__amended_with_a_reason__sessions_that_began_keep_their_version(store, clock):
    presented = begin(store, clock, trials=4)
    before = all_of(store, "S1")
    with pytest.raises(BadInput, match=r"is at version 1 of its protocol, .*--amend"):
        opened_study(store, clock, OTHER)
    study = opened_study(store, clock, OTHER, amend="60 Hz is mains")
    rows = rows_of(store, select(schema.protocol_version).order_by(schema.protocol_version.c.number))
    assert [(row.number, row.reason, row.toml) for row in rows] == [(1, "", PROTOCOL), (2, "60 Hz is mains", OTHER)]
    with pytest.raises(BadInput, match="version 1 of study 'short', which is at 2"):
        opened_study(store, clock)
    assert all_of(store, "S1") == before
    frequencies = {key: {hertz for _, hertz in runs} for key, runs in orders(study).items()}
    assert frequencies["S1", 1] == {30.0, 90.0, 210.0}
    assert frequencies["S2", 1] == {33.0, 90.0, 150.0, 210.0}
    again = open_session(study, "S1")
    assert again.next_trial().trial == presented.next_trial().trial
    begin(store, clock, OTHER, subject=1, trials=1)
    versions = {code: {number for number, _ in versions_of_runs(store, code)} for code in ("S1", "S2")}
    assert versions == {"S1": {1}, "S2": {2}}
    run = schema.run.c
    told = rows_of(store, select(run.respondent, run.rig_simulated, run.shown, run.rig_rate_hz, run.speed))
    assert set(told) == {("person", True, "", 4000.0, None)}


@pytest.mark.parametrize(("consent", "answered"), [("You may stop at any time.", 0), ("", 2)])
def test_study__amended_after_consent__later_runs_are_of_the_sessions_version(store, consent, answered, clock) -> None:
    before, after = (text.replace("You may stop at any time.", consent) for text in (PROTOCOL, OTHER))
    begin(store, clock, before, trials=answered)
    opened_study(store, clock, after, amend="60 Hz is mains")
    begin(store, clock, after, trials=4)
    found = versions_of_runs(store, "S1")
    assert [version for version, _ in found] == [1, 1]
    assert {hertz for _, hertz in found} <= {30.0, 90.0, 210.0}


def test_visits__of_a_subject__have_links_orders_and_seeds_of_their_own(store) -> None:
    text = PROTOCOL.replace('experimenter = "EX"', 'experimenter = "EX"\nvisits = 2')
    study = opened_study(store, ObedientClock(), text)
    links = {(row.subject_code, row.visit): row.link_token for row in study.sessions()}
    assert sorted(links) == [("S1", 1), ("S1", 2), ("S2", 1), ("S2", 2)]
    assert len(set(links.values())) == 4
    found = orders(study)
    assert found["S1", 1] == orders(opened_study(store, ObedientClock(), text))["S1", 1]
    assert sorted(found["S1", 1]) == sorted(found["S1", 2])
    assert found["S1", 1] != found["S1", 2]
    first, second = (study.session(row) for row in study.sessions()[:2])
    assert first.task.begin(first.runs[1], 0, 1).seed != second.task.begin(second.runs[1], 0, 2).seed
    first.give_consent()
    first.withdraw(keep=True)
    assert open_session(study, "S1").id == study.sessions()[1].id  # the first visit is over
    edit(study, "add_visit", "S2")
    assert [row.visit for row in study.sessions() if row.subject_code == "S2"] == [1, 2, 3]
    with pytest.raises(BadInput, match="'S9' is not in the study"):
        edit(study, "add_visit", "S9")


def edit(study, what, *values) -> None:
    with study.editing() as opened:
        getattr(opened, what)(*values)


def asking(store, seed="seed = 7"):
    study = opened_study(store, ObedientClock(), ASKS.replace("seed = 7", seed))
    edit(study, "enrol", SubjectPart(code="S7", participant_id="P-07", demographics={"age": "31", "hand": "left"}))
    return study


def test_enrol__with_what_the_laboratory_asks__is_kept_and_checked(store) -> None:
    study = asking(store)
    fact = schema.demographic.c
    facts = [("hand", "right", ""), ("hand", "right", ""), ("age", "31", "year"), ("hand", "left", "")]
    assert rows_of(store, select(fact.name, fact.value, fact.unit)) == facts
    for part, words in (
        (SubjectPart(code="S7"), "'S7' is enrolled already"),
        (SubjectPart(code="S8", participant_id="P-07"), "'P-07' is another subject's"),
        (SubjectPart(code="S8", demographics={"age": "7", "hand": "left"}), "age is '7'; it must be .* from 18 to 99"),
        (SubjectPart(code="S8", demographics={"age": "inf", "hand": "left"}), "age: 'inf'; expected a number"),
        (SubjectPart(code="S8", demographics={"age": "20"}), "hand is not given"),
        (SubjectPart(code="S8"), "hand is not given"),
        (SubjectPart(code="S8", demographics={"hand": " "}), "hand is not given"),
        (SubjectPart(code="S8", demographics={"hand": "third"}), "hand is 'third'; it must be left, right"),
        (SubjectPart(code="S8", demographics={"size": "1"}), "'size'; expected age, hand"),
    ):
        with pytest.raises(BadInput, match=words):
            edit(study, "enrol", part)
    assert [row.subject_code for row in study.sessions()] == ["S1", "S2", "S7"]
    assert [row.participant_id for row in study.sessions()] == [None, None, "P-07"]


def test_claim__of_any_identity__is_an_event_that_names_none_and_one_answer_refuses_all(store) -> None:
    study = asking(store)
    first, second = study.sessions()[:2]
    claims = [(first, "abc.1"), (first, "abc.1"), (first, "other"), (second, "abc.1"), (second, "a b")]
    with study.editing("subject") as opened:
        assert [opened.claim(*claim) for claim in claims] == [True, True, False, False, False]
    assert [row.participant_id for row in study.sessions()] == ["abc.1", None, "P-07"]
    event = schema.event.c
    found = rows_of(store, select(event.session_id, event.kind, event.detail).where(event.kind.startswith("claim")))
    assert [tuple(row) for row in found] == [
        (first.id, "claimed", ""), (first.id, "claimed", ""), (first.id, "claim-refused", "the subject has another"),
        (second.id, "claim-refused", "it is another subject's"), (second.id, "claim-refused", "it cannot be one"),
    ]  # fmt: skip
    assert not any(name in str(found) for name in ("abc.1", "other id", "a b"))


def changes(store, kind):
    event = schema.event.c
    query = select(schema.subject.c.code, event.item, event.before, event.after).select_from(
        schema.event.join(schema.subject, schema.subject.c.id == event.subject_id)
    )
    return [tuple(row) for row in rows_of(store, query.where(event.kind == kind).order_by(event.id))]


def test_correct__of_subject_and_visit__is_written_and_what_stood_there_is_kept(store) -> None:
    study = asking(store, "seed = 7\nvisits = 2")
    edit(study, "enrol", SubjectPart(code="S8", demographics={"age": 40.0, "hand": "left"}))
    others = [all_of(store, code) for code in ("S1", "S2", "S8")]
    facts = dict(study.facts())
    edit(study, "correct", "S7", Correction("hearing", "P-70", {"age": "", "hand": "right"}), "a slip")
    edit(study, "correct", "S7", Correction(visit=2, skin_temperature_c=30.5), "read again")
    row = next(one for one in study.sessions() if one.subject_code == "S7" and one.visit == 2)
    assert (row.subject_group, row.participant_id, row.skin_temperature_c) == ("hearing", "P-70", 30.5)
    assert study.facts() == {**facts, row.subject_id: {"hand": "right"}}
    assert {"age": "40", "hand": "left"} in facts.values()  # a number of a protocol file is written as it stood there
    assert changes(store, "correction") == [
        ("S7", "subject_group", "unknown", "hearing"),
        ("S7", "outside_id", "P-07", "P-70"),
        ("S7", "age", "31", None),
        ("S7", "hand", "left", "right"),
        ("S7", "skin_temperature_c", "31", "30.5"),
    ]
    edit(study, "set_day", row.id, 31.5, 0.4)
    assert changes(store, "day") == [("S7", "skin_temperature_c", "30.5", "31.5"), ("S7", "preload_n", None, "0.4")]
    day = next(one for one in study.sessions() if one.id == row.id)
    assert (day.skin_temperature_c, day.preload_n) == (31.5, 0.4)
    reasons = [detail for (detail,) in rows_of(store, select(schema.event.c.detail))]
    assert reasons == ["a slip"] * 4 + ["read again", "", ""]
    assert [all_of(store, code) for code in ("S1", "S2", "S8")] == others


def test_correct__what_cannot_be__is_refused_and_changes_nothing(store) -> None:
    study = asking(store, "seed = 7\nvisits = 2")
    edit(study, "enrol", SubjectPart(code="S8", participant_id="P-08", demographics={"hand": "left"}))
    before = all_of(store, "S7"), study.facts()
    for subject, correction, reason, words in (
        ("S7", Correction(group="hearing"), " ", "no reason; "),
        ("S9", Correction(group="hearing"), "why", "'S9' is not in the study"),
        ("S7", Correction(group="unknown"), "why", "nothing of subject 'S7' differs"),
        ("S7", Correction(), "why", "nothing of subject 'S7' differs"),
        ("S7", Correction(participant_id="P-08"), "why", "'P-08' is another subject's"),
        ("S7", Correction(facts={"age": "7"}), "why", "age is '7'; it must be a number from 18 to 99"),
        ("S7", Correction(facts={"hand": ""}), "why", "hand is not given"),
        ("S7", Correction(facts={"size": "7"}), "why", "'size'; expected age, hand"),
        ("S7", Correction(visit=3, preload_n=1.0), "why", "visit 3 of subject 'S7' is not planned; expected 1 to 2"),
        ("S7", Correction(preload_n=1.0), "why", "who has 2 visits; expected with the visit"),
        ("S7", Correction(group="hearing", facts={"hand": "third"}), "why", "hand is 'third'"),
    ):
        with pytest.raises(BadInput, match=words):
            edit(study, "correct", subject, correction, reason)
        assert (all_of(store, "S7"), study.facts()) == before
    assert changes(store, "correction") == []
