"""Studies that live: versions of the protocol, subjects who come later, visits, the data of the day."""

import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.protocol.study import SubjectPart
from tactuator.experiment.session.studies import Correction, open_session
from tactuator.experiment.store import schema
from tactuator.experiment.store.records import Sitting
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin, opened_study, rows_of

THIRD = PROTOCOL + '[[subject]]\ncode = "S3"\ngroup = "hearing"\n'
OTHER = PROTOCOL.replace("[30, 90, 210]", "[33, 90, 150, 210]")
ASKS = PROTOCOL + (
    '[[demographic]]\nname = "age"\nlabel = "Age"\nkind = "number"\nunit = "year"\nlow = 18\nhigh = 99\n'
    '[[demographic]]\nname = "hand"\nlabel = "Hand"\nkind = "choice"\nchoices = ["left", "right"]\nrequired = true\n'
)


def all_of(store, subject):
    """Everything that the store has of a subject."""
    with store.read() as connection:
        who = connection.execute(select(schema.subject).where(schema.subject.c.code == subject)).one()
        sessions = connection.execute(select(schema.session).where(schema.session.c.subject_id == who.id)).all()
        ids = [row.id for row in sessions]
        runs = connection.execute(select(schema.run).where(schema.run.c.session_id.in_(ids))).all()
        trials = connection.execute(
            select(schema.trial).where(schema.trial.c.run_id.in_([one.id for one in runs]))
        ).all()
        answers = connection.execute(
            select(schema.response).where(schema.response.c.trial_id.in_([one.id for one in trials]))
        ).all()
    return [who, sessions, runs, trials, answers]


def orders(study):
    return {
        (row.subject_code, row.visit): [(run.finger, run.frequency_hz) for run in study.session(row).runs]
        for row in study.sessions()
    }


def test_study__subject_added_to_the_file__leaves_the_others_as_they_are(store, clock) -> None:
    presented = begin(store, clock, trials=5)
    before, order = all_of(store, "S1"), orders(opened_study(store, clock))
    study = opened_study(store, clock, THIRD)
    assert all_of(store, "S1") == before
    assert {key: runs for key, runs in orders(study).items() if key[0] != "S3"} == order
    assert [row.subject_code for row in study.sessions()] == ["S1", "S2", "S3"]
    assert [row.link_token for row in study.sessions()] == ["token-S1", "token-S2", "token-S3"]
    again = begin(store, clock, THIRD)
    assert again.session.next_trial().trial == presented.session.next_trial().trial


def test_study__subject_put_first_in_the_file__does_not_move_the_others(store, clock) -> None:
    order = orders(opened_study(store, clock))
    first = PROTOCOL.replace('[[subject]]\ncode = "S1"', '[[subject]]\ncode = "S0"\n[[subject]]\ncode = "S1"', 1)
    after = orders(opened_study(store, clock, first))
    assert {key: after[key] for key in order} == order
    assert after["S0", 1] not in (order["S1", 1], order["S2", 1])


def test_study__protocol_that_says_something_else__takes_a_reason(store, clock) -> None:
    opened_study(store, clock)
    with pytest.raises(BadInput, match=r"stands at version 1 of its protocol, .*--amend"):
        opened_study(store, clock, OTHER)
    study = opened_study(store, clock, OTHER, amend="60 Hz is mains")
    rows = rows_of(store, select(schema.protocol_version).order_by(schema.protocol_version.c.number))
    assert [(row.number, row.reason, row.toml) for row in rows] == [(1, "", PROTOCOL), (2, "60 Hz is mains", OTHER)]
    assert study.version == rows[1].id
    with pytest.raises(BadInput, match="version 1 of study 'short', which stands at 2"):
        opened_study(store, clock)


def test_study__amended__sessions_that_began_stay_with_their_version_and_others_follow(store, clock) -> None:
    presented = begin(store, clock, trials=4)
    before = all_of(store, "S1")
    study = opened_study(store, clock, OTHER, amend="60 Hz is mains")
    assert all_of(store, "S1") == before
    frequencies = {key: {hertz for _, hertz in runs} for key, runs in orders(study).items()}
    assert frequencies["S1", 1] == {30.0, 90.0, 210.0}
    assert frequencies["S2", 1] == {33.0, 90.0, 150.0, 210.0}
    again = open_session(study, "S1")
    assert again.next_trial().trial == presented.session.next_trial().trial
    other = begin(store, clock, OTHER, subject=1)
    answer_one(other, clock)
    versions = {code: {number for number, _ in versions_of_runs(store, code)} for code in ("S1", "S2")}
    assert versions == {"S1": {1}, "S2": {2}}


def versions_of_runs(store, subject):
    """The version of the protocol of each of a subject's runs, and the frequency."""
    query = (
        select(schema.protocol_version.c.number, schema.run.c.frequency_hz)
        .select_from(
            schema.run.join(schema.session)
            .join(schema.subject, schema.subject.c.id == schema.session.c.subject_id)
            .join(schema.protocol_version, schema.protocol_version.c.id == schema.run.c.protocol_version_id)
        )
        .where(schema.subject.c.code == subject)
        .order_by(schema.run.c.id)
    )
    with store.read() as connection:
        return [tuple(row) for row in connection.execute(query)]


@pytest.mark.parametrize(
    ("consent", "answered"),
    [("You may stop at any time.", 0), ("", 2)],
    ids=["consent is given", "practice is done, consent is not asked for"],
)
def test_study__amended_once_a_session_has_begun__its_later_runs_are_of_its_own_version(
    store, consent, answered, clock
) -> None:
    """What begins a session is consent or, where none is asked for, the first trial."""
    before, after = (text.replace("You may stop at any time.", consent) for text in (PROTOCOL, OTHER))
    presented = begin(store, clock, before)
    for _ in range(answered):
        answer_one(presented, clock)
    opened_study(store, clock, after, amend="60 Hz is mains")
    begin(store, clock, after, trials=4)
    found = versions_of_runs(store, "S1")
    assert [version for version, _ in found] == [1, 1]
    assert {hertz for _, hertz in found} <= {30.0, 90.0, 210.0}


def test_study__same_protocol_again__is_the_same_study(store, clock) -> None:
    first, again = opened_study(store, clock), opened_study(store, clock)
    assert (first.id, first.version) == (again.id, again.version)
    assert len(again.sessions()) == 2


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
    assert first.task.course(first.runs[1], 0, 1).seed != second.task.course(second.runs[1], 0, 2).seed
    study.add_visit("S2")
    assert [row.visit for row in study.sessions() if row.subject_code == "S2"] == [1, 2, 3]
    with pytest.raises(BadInput, match="'S9' is not in the study"):
        study.add_visit("S9")


def test_open_session__first_visit_over__is_the_next(store, clock) -> None:
    text = PROTOCOL.replace('experimenter = "EX"', 'experimenter = "EX"\nvisits = 2')
    first = begin(store, clock, text)
    first.withdraw(keep=True)
    study = opened_study(store, clock, text)
    assert open_session(study, "S1").id == study.sessions()[1].id


def test_enrol__with_what_the_laboratory_asks__is_kept_and_checked(store) -> None:
    study = opened_study(store, ObedientClock(), ASKS)
    study.enrol(SubjectPart(code="S7", participant_id="P-07", demographics={"age": "31", "hand": "left"}))
    with store.read() as connection:
        facts = connection.execute(
            select(schema.demographic.c.name, schema.demographic.c.value, schema.demographic.c.unit)
        )
        assert [tuple(row) for row in facts] == [("age", "31", "year"), ("hand", "left", "")]
    for part, words in (
        (SubjectPart(code="S7"), "'S7' is enrolled already"),
        (SubjectPart(code="S8", participant_id="P-07"), "'P-07' is another subject's"),
        (
            SubjectPart(code="S8", demographics={"age": "7", "hand": "left"}),
            "age is '7'; allowed: a number from 18 to 99",
        ),
        (SubjectPart(code="S8", demographics={"age": "inf", "hand": "left"}), "age is 'inf'"),
        (SubjectPart(code="S8", demographics={"age": "20"}), "hand is not given"),
        (SubjectPart(code="S8", demographics={"hand": "third"}), "hand is 'third'; allowed: left, right"),
        (SubjectPart(code="S8", demographics={"size": "1"}), "'size'; allowed: age, hand"),
    ):
        with pytest.raises(BadInput, match=words):
            study.enrol(part)
    assert [row.subject_code for row in study.sessions()] == ["S1", "S2", "S7"]


def test_claim__participant_id__is_kept_once_and_never_anothers(store) -> None:
    study = opened_study(store, ObedientClock())
    first, second = study.sessions()
    study.claim(first, "abc.1")
    study.claim(first, "abc.1")
    for row, name in ((first, "other"), (second, "abc.1")):
        with pytest.raises(BadInput, match="another participant's"):
            study.claim(row, name)
    with pytest.raises(BadInput, match="1 to 64 letters"):
        study.claim(second, "a b")
    assert [row.participant_id for row in study.sessions()] == ["abc.1", None]


def test_day__written_twice__keeps_what_was_there_as_an_event(store) -> None:
    study = opened_study(store, ObedientClock())
    session = study.sessions()[0].id
    study.set_day(session, 30.5, 0.4)
    study.set_day(session, 31.5, None)
    row = study.sessions()[0]
    assert (row.skin_temperature_c, row.preload_n) == (31.5, None)
    assert changes(store, "day") == [
        ("S1", "skin_temperature_c", "31", "30.5"),
        ("S1", "preload_n", None, "0.4"),
        ("S1", "skin_temperature_c", "30.5", "31.5"),
        ("S1", "preload_n", "0.4", None),
    ]


def changes(store, kind):
    """Subject, item, before and after of every change of that kind."""
    event = schema.event.c
    query = select(schema.subject.c.code, event.item, event.before, event.after).select_from(
        schema.event.join(schema.subject, schema.subject.c.id == event.subject_id)
    )
    with store.read() as connection:
        return [tuple(row) for row in connection.execute(query.where(event.kind == kind).order_by(event.id))]


def test_correct__of_subject_and_visit__is_written_and_what_stood_there_is_kept(store) -> None:
    study = opened_study(store, ObedientClock(), ASKS.replace("seed = 7", "seed = 7\nvisits = 2"))
    study.enrol(SubjectPart(code="S7", participant_id="P-07", demographics={"age": "31", "hand": "left"}))
    study.enrol(SubjectPart(code="S8", demographics={"age": 40.0, "hand": "left"}))
    others = [all_of(store, code) for code in ("S1", "S2", "S8")]
    facts = dict(study.facts())
    study.correct("S7", Correction("hearing", "P-70", {"age": "", "hand": "right"}), "a slip")
    study.correct("S7", Correction(visit=2, skin_temperature_c=30.5), "read again")
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
    reasons = [detail for (detail,) in rows_of(store, select(schema.event.c.detail))]
    assert reasons == ["a slip"] * 4 + ["read again"]
    assert [all_of(store, code) for code in ("S1", "S2", "S8")] == others


@pytest.mark.parametrize(
    ("subject", "correction", "reason", "words"),
    [
        ("S7", Correction(group="hearing"), " ", "no reason; allowed"),
        ("S9", Correction(group="hearing"), "why", "'S9' is not in the study"),
        ("S7", Correction(group="unknown"), "why", "nothing of subject 'S7' differs"),
        ("S7", Correction(), "why", "nothing of subject 'S7' differs"),
        ("S7", Correction(participant_id="P-08"), "why", "'P-08' is another subject's"),
        ("S7", Correction(facts={"age": "7"}), "why", "age is '7'; allowed: a number from 18 to 99"),
        ("S7", Correction(facts={"hand": ""}), "why", "hand is not given"),
        ("S7", Correction(facts={"size": "7"}), "why", "'size'; allowed: age, hand"),
        ("S7", Correction(visit=3, preload_n=1.0), "why", "visit 3 of subject 'S7' is not planned; allowed: 1 to 2"),
        ("S7", Correction(preload_n=1.0), "why", "who has 2 visits; allowed: with the visit"),
        ("S7", Correction(group="hearing", facts={"hand": "third"}), "why", "hand is 'third'"),
    ],
)
def test_correct__what_cannot_be__is_refused_and_changes_nothing(store, subject, correction, reason, words) -> None:
    study = opened_study(store, ObedientClock(), ASKS.replace("seed = 7", "seed = 7\nvisits = 2"))
    study.enrol(SubjectPart(code="S7", participant_id="P-07", demographics={"age": "31", "hand": "left"}))
    study.enrol(SubjectPart(code="S8", participant_id="P-08"))
    before = all_of(store, "S7"), study.facts()
    with pytest.raises(BadInput, match=words):
        study.correct(subject, correction, reason)
    assert (all_of(store, "S7"), study.facts()) == before
    assert changes(store, "correction") == []


def test_run__who_answered__is_stored(store, clock) -> None:
    study = opened_study(store, clock)
    session = open_session(study, "S1", sitting=Sitting("simulated"))
    session.give_consent()
    session.next_trial()
    (run,) = rows_of(store, select(schema.run))
    assert (run.respondent, run.rig_simulated, run.shown, run.rig_rate_hz, run.speed) == (
        "simulated",
        True,
        "",
        4000.0,
        None,
    )
