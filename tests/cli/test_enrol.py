"""The verbs `experiment enrol` and `correct`: subjects and visits without a server, held against the store's rows."""

import csv

import pytest
from sqlalchemy import select

from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store, sessions_of
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin, opened_study

AGE = '[[demographic]]\nname = "age"\nlabel = "Age"\nkind = "number"\nhigh = 120\n\n'
ASKED = PROTOCOL.replace("[[subject]]", AGE + "[[subject]]", 1)
STORE = ("--store", "lab.db")
ENROL, CORRECT = ("experiment", "enrol"), ("experiment", "correct")


@pytest.fixture
def lab(desk):
    """A store with one study, whose first subject has answered once."""
    store, clock = Store(desk / "lab.db"), ObedientClock()
    answer_one(begin(store, clock, ASKED), clock)
    store.close()
    return desk / "lab.db"


def rows(path):
    """Return code, number, group, participant id, visit and link of every session, in order."""
    store, who, session = Store(path), schema.subject.c, schema.session.c
    query = select(
        who.code, who.number, who.subject_group, who.participant_id, session.visit, session.link_token
    ).select_from(schema.session.join(schema.subject)).order_by(who.number, session.visit)  # fmt: skip
    with store.read() as connection:
        sessions = [tuple(row) for row in connection.execute(query)]
    store.close()
    return sessions


def test_enrol__new_subject_then_a_visit__are_in_the_store_and_nobody_else_changes(lab, run) -> None:
    before = rows(lab)
    facts = ("--group", "hearing", "--participant-id", "sub-77", "--fact", "age=34")
    first = run.json(*ENROL, "S9", *facts, *STORE)["visits"]
    both = run.json(*ENROL, "S9", "--visit", *STORE)["visits"]
    after = rows(lab)
    assert after[: len(before)] == before
    mine = after[len(before) :]
    assert [row[:5] for row in mine] == [("S9", len(before), "hearing", "sub-77", visit) for visit in (1, 2)]
    assert [visit["path"] for visit in both] == [f"/s/{row[5]}" for row in mine]
    assert first == both[:1]
    assert len({row[5] for row in after}) == len(after)


def test_enrol__study_was_amended__is_by_its_newest_version(lab, run) -> None:
    """The newest version asks for the hand, and lets everybody come three times."""
    hand = '[[demographic]]\nname = "hand"\nlabel = "Hand"\n\n'
    amended = ASKED.replace(AGE, AGE + hand).replace("seed = 7", "seed = 7\nvisits = 3")
    store = Store(lab)
    opened_study(store, ObedientClock(), amended, amend="hands differ")
    store.close()
    assert run(*ENROL, "S9", "--fact", "hand=left", *STORE).status == 0
    assert [row[4] for row in rows(lab) if row[0] == "S9"] == [1, 2, 3]


def test_correct__data_of_a_subject__are_changed_and_the_export_knows_both(lab, run, desk) -> None:
    assert run(*ENROL, "S9", "--fact", "age=43", *STORE).status == 0
    values = ("--group", "hearing", "--fact", "age=34", "--skin-temperature-c", "30.5", "--preload-n", "0.4")
    changes = run.json(*CORRECT, "S9", "--reason", "typing error", *values, *STORE)["changes"]
    assert [(change["item"], change["before"], change["after"]) for change in changes] == [
        ("subject_group", "unknown", "hearing"), ("age", "43", "34"), ("skin_temperature_c", "31", "30.5"),
        ("preload_n", None, "0.4"),
    ]  # fmt: skip
    assert run(*CORRECT, "S9", "--reason", "does not say", "--fact", "age=", *STORE).status == 0
    assert run("experiment", "export", "--out", "out", *STORE).status == 0
    tables = {
        name: list(csv.DictReader((desk / "out" / name).read_text().splitlines()))
        for name in ("subjects.csv", "events.csv")
    }
    subject = next(row for row in tables["subjects.csv"] if row["subject"] == "S9")
    assert (subject["subject_group"], subject["age"]) == ("hearing", "")
    events = [row for row in tables["events.csv"] if row["kind"] == "correction"]
    assert [(row["subject"], row["item"], row["before"], row["after"], row["detail"]) for row in events] == [
        *(("S9", change["item"], change["before"] or "", change["after"], "typing error") for change in changes),
        ("S9", "age", "34", "", "does not say"),
    ]  # fmt: skip


AMISS = {
    "enrol S1": "subject 'S1' is enrolled already; allowed: a code that is not taken",
    "enrol S9 --group =deaf": "subject: group is '=deaf'; allowed: 1 to 64 letters, digits",
    "enrol S9 --fact age": "--fact 'age'; allowed: NAME=VALUE",
    "enrol S9 --fact age=3 --fact age=4": "--fact twice for a name; allowed: each name once",
    "enrol S9 --skin-temperature-c 90": "subject: skin_temperature_c is 90; allowed: a number, above 0, bel",
    "enrol S9 --study another": "study 'another' is not in the store; allowed: ",
    "enrol S9 --visit": "subject 'S9' is not in the study; allowed: one that is enrolled",
    "enrol S1 --visit --group hearing": "--visit with facts of a new subject; allowed: --visit alone",
    "correct S1 --reason why": "nothing of subject 'S1' differs",
    "correct S1 --reason why --preload-n -1": "subject: preload_n is -1; allowed: a number of 0 or more",
}
RUNNING = "its sessions are run by process"


def test_enrol_and_correct__bad_input_or_sessions_being_run__is_one_line_and_changes_nothing(lab, run) -> None:
    before = rows(lab)
    for command, words in AMISS.items():
        run.refused("experiment", *command.split(), *STORE, said=words)
    with sessions_of(lab):
        run.refused(*ENROL, "S9", *STORE, said=RUNNING)
        run.refused(*CORRECT, "S1", "--reason", "why", "--group", "unknown", *STORE, said=RUNNING)
    assert rows(lab) == before
