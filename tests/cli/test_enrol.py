"""The verb `experiment enrol`: subjects and visits without a server, held against the store's rows."""

import json

import pytest
from sqlalchemy import select

from tactuator.cli.main import main
from tactuator.experiment.store import schema
from tactuator.experiment.store.lock import sessions_of
from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, begin, opened_study

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


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["S1"], "subject 'S1' is enrolled already; allowed: a code that is not taken"),
        (["S 9"], "subject: code is 'S 9'; allowed: String should match pattern"),
        (["S9", "--group", "deaf"], "subject: group is 'deaf'; allowed: hearing, hearing-impaired, simulated, unknown"),
        (["S9", "--fact", "age"], "--fact 'age'; allowed: NAME=VALUE"),
        (["S9", "--fact", "age=130"], "age is '130'; allowed: a number from -1e+12 to 120"),
        (["S9", "--fact", "size=4"], "demographics: 'size'; allowed: age"),
        (["S9", "--fact", "age=3", "--fact", "age=4"], "--fact twice for a name; allowed: each name once"),
        (["S9", "--skin-temperature-c", "90"], "subject: skin_temperature_c is 90.0; allowed: Input should be less"),
        (["S9", "--study", "another"], "study 'another' is not in the store; allowed: "),
        (["S9", "--visit"], "subject 'S9' is not in the study; allowed: one that is enrolled"),
        (["S1", "--visit", "--group", "hearing"], "--visit with facts of a new subject; allowed: --visit alone"),
    ],
)
def test_enrol__bad_input__is_one_line_and_changes_nothing(lab, capsys, arguments, words) -> None:
    before = rows(lab)
    assert enrol(lab, *arguments) == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1
    assert rows(lab) == before


def test_enrol__sessions_are_being_run__is_refused(lab, capsys) -> None:
    with sessions_of(lab):
        assert enrol(lab, "S9") == 2
    assert "its sessions are run by process" in capsys.readouterr().err


def test_enrol__no_store__is_refused_and_none_is_made(tmp_path, capsys) -> None:
    assert enrol(tmp_path / "missing.db", "S9") == 2
    assert not (tmp_path / "missing.db").exists()
    assert capsys.readouterr().err.count("\n") == 1
