"""The verbs `experiment enrol` and `correct`: subjects and visits without a server, held against the store's rows."""

import csv
import json

import pytest
from sqlalchemy import select

from tactuator.cli.main import main
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store, sessions_of
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin, opened_study

AGE = '[[demographic]]\nname = "age"\nlabel = "Age"\nkind = "number"\nhigh = 120\n\n'
ASKED = PROTOCOL.replace("[[subject]]", AGE + "[[subject]]", 1)


@pytest.fixture
def lab(tmp_path):
    """A store with one study that has begun."""
    store = Store(tmp_path / "lab.db")
    begin(store, ObedientClock(), ASKED)
    store.close()
    return tmp_path / "lab.db"


def rows(path):
    """Return code, number, group, participant id, visit and link of every session, in order."""
    store, who, session = Store(path), schema.subject.c, schema.session.c
    query = select(
        who.code, who.number, who.subject_group, who.participant_id, session.visit, session.link_token
    ).select_from(schema.session.join(schema.subject)).order_by(who.number, session.visit)  # fmt: skip
    with store.read() as connection:
        found = [tuple(row) for row in connection.execute(query)]
    store.close()
    return found


def enrol(path, *arguments: str) -> int:
    return main(["experiment", "enrol", *arguments, "--store", str(path)])


def test_enrol__new_subject_then_a_visit__are_in_the_store_and_nobody_else_changes(lab, capsys) -> None:
    before = rows(lab)
    facts = ["--group", "hearing", "--participant-id", "sub-77", "--fact", "age=34"]
    assert enrol(lab, "S9", *facts, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert enrol(lab, "S9", "--visit", "--json") == 0
    again = json.loads(capsys.readouterr().out)
    after = rows(lab)
    assert after[: len(before)] == before
    mine = after[len(before) :]
    assert [row[:5] for row in mine] == [("S9", len(before), "hearing", "sub-77", visit) for visit in (1, 2)]
    assert [one["path"] for one in again["visits"]] == [f"/s/{row[5]}" for row in mine]
    assert told["visits"] == again["visits"][:1]
    assert len({row[5] for row in after}) == len(after)


def test_enrol__study_was_amended__is_by_its_newest_version(lab, capsys) -> None:
    """The newest version asks for the hand, and lets everybody come three times."""
    hand = '[[demographic]]\nname = "hand"\nlabel = "Hand"\n\n'
    amended = ASKED.replace(AGE, AGE + hand).replace("seed = 7", "seed = 7\nvisits = 3")
    store = Store(lab)
    opened_study(store, ObedientClock(), amended, amend="hands differ")
    store.close()
    assert enrol(lab, "S9", "--fact", "hand=left") == 0
    assert [row[4] for row in rows(lab) if row[0] == "S9"] == [1, 2, 3]
    capsys.readouterr()


def test_enrol__no_store__is_refused_and_none_is_made(tmp_path, capsys) -> None:
    assert enrol(tmp_path / "missing.db", "S9") == 2
    assert not (tmp_path / "missing.db").exists()
    assert capsys.readouterr().err.count("\n") == 1


def correct(path, *arguments: str) -> int:
    return main(["experiment", "correct", *arguments, "--store", str(path)])


def test_correct__data_of_a_subject__are_changed_and_the_export_knows_both(lab, capsys, tmp_path) -> None:
    store, clock = Store(lab), ObedientClock()
    answer_one(begin(store, clock, ASKED), clock)
    store.close()
    assert enrol(lab, "S9", "--fact", "age=43") == 0
    values = ["--group", "hearing", "--fact", "age=34", "--skin-temperature-c", "30.5", "--preload-n", "0.4"]
    capsys.readouterr()
    assert correct(lab, "S9", "--reason", "typing error", *values, "--json") == 0
    told = json.loads(capsys.readouterr().out)["changes"]
    assert [(one["item"], one["before"], one["after"]) for one in told] == [
        ("subject_group", "unknown", "hearing"), ("age", "43", "34"), ("skin_temperature_c", "31", "30.5"),
        ("preload_n", None, "0.4"),
    ]  # fmt: skip
    assert correct(lab, "S9", "--reason", "does not say", "--fact", "age=") == 0
    assert main(["experiment", "export", "--store", str(lab), "--out", str(tmp_path / "out")]) == 0
    with (tmp_path / "out" / "subjects.csv").open() as stream:
        subject = next(row for row in csv.DictReader(stream) if row["subject"] == "S9")
    with (tmp_path / "out" / "events.csv").open() as stream:
        events = [row for row in csv.DictReader(stream) if row["kind"] == "correction"]
    assert (subject["subject_group"], subject["age"]) == ("hearing", "")
    assert [(row["subject"], row["item"], row["before"], row["after"], row["detail"]) for row in events] == [
        ("S9", "subject_group", "unknown", "hearing", "typing error"), ("S9", "age", "43", "34", "typing error"),
        ("S9", "skin_temperature_c", "31", "30.5", "typing error"), ("S9", "preload_n", "", "0.4", "typing error"),
        ("S9", "age", "34", "", "does not say"),
    ]  # fmt: skip


ENROL = [
    (["S1"], "subject 'S1' is enrolled already; allowed: a code that is not taken"),
    (["S 9"], "subject: code is 'S 9'; allowed: 1 to 32 letters and digits"),
    (["S9", "--group", "=deaf"], "subject: group is '=deaf'; allowed: 1 to 64 letters, digits"),
    (["S9", "--fact", "age"], "--fact 'age'; allowed: NAME=VALUE"),
    (["S9", "--fact", "age=130"], "age is '130'; allowed: a number from -1e+12 to 120"),
    (["S9", "--fact", "size=4"], "demographics: 'size'; allowed: age"),
    (["S9", "--fact", "age=3", "--fact", "age=4"], "--fact twice for a name; allowed: each name once"),
    (["S9", "--skin-temperature-c", "90"], "subject: skin_temperature_c is 90; allowed: a number, above 0, bel"),
    (["S9", "--study", "another"], "study 'another' is not in the store; allowed: "),
    (["S9", "--visit"], "subject 'S9' is not in the study; allowed: one that is enrolled"),
    (["S1", "--visit", "--group", "hearing"], "--visit with facts of a new subject; allowed: --visit alone"),
]
CORRECT = [
    (["S9"], "subject 'S9' is not in the study"),
    (["S1"], "nothing of subject 'S1' differs"),
    (["S1", "--group", "=deaf"], "subject: group is '=deaf'; allowed: 1 to 64 letters, digits"),
    (["S1", "--fact", "age"], "--fact 'age'; allowed: NAME=VALUE"),
    (["S1", "--fact", "age=130"], "age is '130'"),
    (["S1", "--skin-temperature-c", "90"], "subject: skin_temperature_c is 90"),
    (["S1", "--preload-n", "-1"], "subject: preload_n is -1; allowed: a number of 0 or more"),
    (["S1", "--visit", "2"], "visit 2 of subject 'S1' is not planned"),
    (["S1", "--study", "another", "--group", "unknown"], "study 'another' is not in the store"),
]


@pytest.mark.parametrize(
    ("verb", "arguments", "words"),
    [(verb, *case) for verb, cases in ((enrol, ENROL), (correct, CORRECT)) for case in cases],
)
def test_verb__bad_input__is_one_line_and_changes_nothing(lab, capsys, verb, arguments, words) -> None:
    before = rows(lab)
    assert verb(lab, *arguments, *(["--reason", "why"] if verb is correct else [])) == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1
    assert rows(lab) == before


@pytest.mark.parametrize(
    ("verb", "arguments"), [(enrol, ["S9"]), (correct, ["S1", "--reason", "why", "--group", "unknown"])]
)
def test_verb__sessions_are_being_run__is_refused(lab, capsys, verb, arguments) -> None:
    with sessions_of(lab):
        assert verb(lab, *arguments) == 2
    assert "its sessions are run by process" in capsys.readouterr().err
