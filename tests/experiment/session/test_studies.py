"""Studies that live: versions of the protocol, subjects who come later, visits, the data of the day."""

import pytest
from sqlalchemy import select

from tactuator.errors import BadInput
from tactuator.experiment.protocol.study import SubjectPart
from tactuator.experiment.session.studies import Correction, open_session
from tactuator.experiment.store import schema
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, begin, opened_study, rows_of

FIRST = PROTOCOL.replace('[[subject]]\ncode = "S1"', '[[subject]]\ncode = "S0"\n[[subject]]\ncode = "S1"', 1)
OTHER = PROTOCOL.replace("[30, 90, 210]", "[33, 90, 150, 210]")
ASKS = PROTOCOL + (
    '[[demographic]]\nname = "age"\nlabel = "Age"\nkind = "number"\nunit = "year"\nlow = 18\nhigh = 99\n'
    '[[demographic]]\nname = "hand"\nlabel = "Hand"\nkind = "choice"\nchoices = ["left", "right"]\nrequired = true\n'
)


RUNS = schema.run.join(schema.session).join(schema.subject, schema.subject.c.id == schema.session.c.subject_id)


def all_of(store, subject):
    """Everything that the store has of a subject."""
    tables = RUNS.outerjoin(schema.trial).outerjoin(schema.response)
    of_subject = schema.subject.c.code == subject
    people = select(schema.subject, schema.session).join_from(schema.subject, schema.session).where(of_subject)
    answers = select(schema.run, schema.trial, schema.response).select_from(tables).where(of_subject)
    return rows_of(store, people), rows_of(store, answers)


def versions_of_runs(store, subject):
    """The version of the protocol of each of a subject's runs, and the frequency."""
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
    assert again.session.next_trial().trial == presented.session.next_trial().trial


def test_study__amended_with_a_reason__sessions_that_began_stay_with_their_version_and_others_follow(
    store, clock
) -> None:
    presented = begin(store, clock, trials=4)
    before = all_of(store, "S1")
    with pytest.raises(BadInput, match=r"stands at version 1 of its protocol, .*--amend"):
        opened_study(store, clock, OTHER)
    study = opened_study(store, clock, OTHER, amend="60 Hz is mains")
    rows = rows_of(store, select(schema.protocol_version).order_by(schema.protocol_version.c.number))
    assert [(row.number, row.reason, row.toml) for row in rows] == [(1, "", PROTOCOL), (2, "60 Hz is mains", OTHER)]
    with pytest.raises(BadInput, match="version 1 of study 'short', which stands at 2"):
        opened_study(store, clock)
    assert all_of(store, "S1") == before
    frequencies = {key: {hertz for _, hertz in runs} for key, runs in orders(study).items()}
    assert frequencies["S1", 1] == {30.0, 90.0, 210.0}
    assert frequencies["S2", 1] == {33.0, 90.0, 150.0, 210.0}
    again = open_session(study, "S1")
    assert again.next_trial().trial == presented.session.next_trial().trial
    begin(store, clock, OTHER, subject=1, trials=1)
    versions = {code: {number for number, _ in versions_of_runs(store, code)} for code in ("S1", "S2")}
    assert versions == {"S1": {1}, "S2": {2}}
    run = schema.run.c
    told = rows_of(store, select(run.respondent, run.rig_simulated, run.shown, run.rig_rate_hz, run.speed))
    assert set(told) == {("person", True, "", 4000.0, None)}


@pytest.mark.parametrize(("consent", "answered"), [("You may stop at any time.", 0), ("", 2)])
def test_study__amended_after_consent_or_a_first_trial__later_runs_are_of_the_sessions_version(
    store, consent, answered, clock
) -> None:
    before, after = (text.replace("You may stop at any time.", consent) for text in (PROTOCOL, OTHER))
    begin(store, clock, before, trials=answered)
    opened_study(store, clock, after, amend="60 Hz is mains")
    begin(store, clock, after, trials=4)
    found = versions_of_runs(store, "S1")
    assert [version for version, _ in found] == [1, 1]
    assert {hertz for _, hertz in found} <= {30.0, 90.0, 210.0}


def test_visits__of_a_subject__have_links_orders_and_seeds_of_their_own_and_come_in_turn(store) -> None:
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
    first.give_consent()
    first.withdraw(keep=True)
    assert open_session(study, "S1").id == study.sessions()[1].id  # the first visit is over
    study.add_visit("S2")
    assert [row.visit for row in study.sessions() if row.subject_code == "S2"] == [1, 2, 3]
    with pytest.raises(BadInput, match="'S9' is not in the study"):
        study.add_visit("S9")


def test_enrol__with_what_the_laboratory_asks__is_kept_and_checked(store) -> None:
    study = opened_study(store, ObedientClock(), ASKS)
    study.enrol(SubjectPart(code="S7", participant_id="P-07", demographics={"age": "31", "hand": "left"}))
    fact = schema.demographic.c
    assert rows_of(store, select(fact.name, fact.value, fact.unit)) == [("age", "31", "year"), ("hand", "left", "")]
    for part, words in (
        (SubjectPart(code="S7"), "'S7' is enrolled already"),
        (SubjectPart(code="S8", participant_id="P-07"), "'P-07' is another subject's"),
        (SubjectPart(code="S8", demographics={"age": "7", "hand": "left"}), "age is '7'; allowed: .* from 18 to 99"),
        (SubjectPart(code="S8", demographics={"age": "inf", "hand": "left"}), "age is 'inf'"),
        (SubjectPart(code="S8", demographics={"age": "20"}), "hand is not given"),
        (SubjectPart(code="S8", demographics={"hand": "third"}), "hand is 'third'; allowed: left, right"),
        (SubjectPart(code="S8", demographics={"size": "1"}), "'size'; allowed: age, hand"),
    ):
        with pytest.raises(BadInput, match=words):
            study.enrol(part)
    first, second = study.sessions()[:2]
    assert [row.subject_code for row in study.sessions()] == ["S1", "S2", "S7"]
    study.claim(first, "abc.1")
    study.claim(first, "abc.1")
    for row, name in ((first, "other"), (second, "abc.1")):
        with pytest.raises(BadInput, match="another participant's"):
            study.claim(row, name)
    with pytest.raises(BadInput, match="1 to 64 letters"):
        study.claim(second, "a b")
    assert [row.participant_id for row in study.sessions()] == ["abc.1", None, "P-07"]


def changes(store, kind):
    """Subject, item, before and after of every change of that kind."""
    event = schema.event.c
    query = select(schema.subject.c.code, event.item, event.before, event.after).select_from(
        schema.event.join(schema.subject, schema.subject.c.id == event.subject_id)
    )
    return [tuple(row) for row in rows_of(store, query.where(event.kind == kind).order_by(event.id))]


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
    study.set_day(row.id, 31.5, 0.4)
    assert changes(store, "day") == [("S7", "skin_temperature_c", "30.5", "31.5"), ("S7", "preload_n", None, "0.4")]
    day = next(one for one in study.sessions() if one.id == row.id)
    assert (day.skin_temperature_c, day.preload_n) == (31.5, 0.4)
    reasons = [detail for (detail,) in rows_of(store, select(schema.event.c.detail))]
    assert reasons == ["a slip"] * 4 + ["read again", "", ""]
    assert [all_of(store, code) for code in ("S1", "S2", "S8")] == others


def test_correct__what_cannot_be__is_refused_and_changes_nothing(store) -> None:
    study = opened_study(store, ObedientClock(), ASKS.replace("seed = 7", "seed = 7\nvisits = 2"))
    study.enrol(SubjectPart(code="S7", participant_id="P-07", demographics={"age": "31", "hand": "left"}))
    study.enrol(SubjectPart(code="S8", participant_id="P-08"))
    before = all_of(store, "S7"), study.facts()
    for subject, correction, reason, words in (
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
    ):
        with pytest.raises(BadInput, match=words):
            study.correct(subject, correction, reason)
        assert (all_of(store, "S7"), study.facts()) == before
    assert changes(store, "correction") == []
