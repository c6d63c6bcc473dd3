"""What is void is left out as if it had been deleted, stays in the store, and comes back when it is asked for."""

import csv
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import select

from tactuator.api.experiment import correct, enrol, erase, export, rename, thresholds, void
from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.protocol.study import SubjectPart
from tactuator.experiment.simulated.subjects import run_study, simulated_observers
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store, opened_store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, apparatus, begin, opened_study, rows_of
from tests.postgres import PostgresServer

STAIRS = 'kind = "up-down"\nstart_db_sl = 20\nsteps_db = [4, 2]\nreversals = 6\naveraged = 4'
TEXT = PROTOCOL.replace(STAIRS, 'kind = "quest-plus"\ntrials = 12').replace('"EX"', '"EX"\nvisits = 2')
DELETED = {
    "visit": "run_id IN (SELECT id FROM run WHERE session_id = 1)",
    "run": "run_id = 2",
    "trial": "run_id = 2 AND number = 5",
}


def fill(store):
    place = apparatus()
    curve = place.controller.display.channels[0].threshold.curve
    with opened_store(store) as made:
        people = simulated_observers(curve, 2, 3, place.band_hz)
        for _ in range(2):
            run_study(made, parse_protocol(TEXT, Protocol), TEXT, place, people, ObedientClock())
    return store


@pytest.fixture(scope="module")
def study_file(tmp_path_factory):
    return fill(tmp_path_factory.mktemp("store") / "lab.db")


@pytest.fixture
def lab(study_file, tmp_path):
    return Path(shutil.copy(study_file, tmp_path / "lab.db"))


def tables(path, folder, **options):
    export(path, folder, **options)
    return {name: (folder / f"{name}.csv").read_text() for name in ("trials", "intervals", "subjects", "thresholds")}


def events_of(path):
    with closing(Store(path)) as store:
        return rows_of(store, select(schema.event.c.kind, schema.event.c.detail))


def without(path, where, copy):
    """A copy of the store in which what `where` says of trials was deleted by hand."""
    shutil.copy(path, copy)
    with closing(sqlite3.connect(copy)) as plain, plain:
        for table, key in (("response", "trial_id"), ("interval", "trial_id"), ("trial", "id")):
            plain.execute(f"DELETE FROM {table} WHERE {key} IN (SELECT id FROM trial WHERE {where})")
        plain.execute("DELETE FROM run WHERE id NOT IN (SELECT run_id FROM trial)")
    return copy


def rows(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def refits(path, **options):
    return [(each.run, each.trials, each.refit_db_sl) for each in thresholds(path, **options).results.thresholds]


@pytest.mark.parametrize(("part", "of"), [("visit", (1, None, None)), ("run", (1, 2, None)), ("trial", (None, 2, 5))])
def test_void__part_of_a_study__is_left_out_as_if_deleted_and_can_be_restored(lab, tmp_path, part, of) -> None:
    before, refitted = tables(lab, tmp_path / "before"), refits(lab)
    bare = without(lab, DELETED[part], tmp_path / "bare.db")
    visit, run, trial = of
    done = void("S1", lab, " a siren ", visit, run, trial, operator="EX")
    assert (done.visit, done.run, done.trial, done.void) == (1, run, trial, True)
    found, expected = tables(lab, tmp_path / "void"), tables(bare, tmp_path / "bare")
    if part == "trial":  # the procedure's own number would be of answers that are not there
        found["thresholds"], expected["thresholds"] = (str(refits(path)) for path in (lab, bare))
    assert found == expected != before
    assert refits(lab) == refits(bare)
    for form in ("psych-ds", "bids"):
        export(lab, tmp_path / form, form)
        assert "a siren" not in "".join(
            path.read_text() for path in (tmp_path / form).rglob("*_data.csv") if "trials" in path.name
        )
    assert refits(lab, voided=True) == refitted
    whole = list(csv.DictReader(tables(lab, tmp_path / "all", voided=True)["trials"].splitlines()))
    assert [{**row, "voided": ""} for row in whole] == list(csv.DictReader(before["trials"].splitlines()))
    marked = [row for row in whole if row["voided"] == "a siren"]
    assert len(marked) == len(before["trials"].splitlines()) - len(found["trials"].splitlines()) > 0
    flagged = [row["run"] for row in rows(tmp_path / "all" / "thresholds.csv") if "void" in row["flags"]]
    assert set(flagged) <= {row["run"] for row in marked}
    assert flagged
    void("S1", lab, "it was nothing", visit, run, trial, restore=True)
    assert tables(lab, tmp_path / "restored") == before
    events = rows(tmp_path / "restored" / "events.csv")
    logged = [(row["kind"], row["subject"], row["visit"], row["detail"]) for row in events if row["item"]]
    assert logged == [("void", "S1", "1", "a siren"), ("restored", "S1", "1", "it was nothing")]
    assert [row["who"] for row in events if row["kind"] == "void"] == ["EX"]


def test_void__what_cannot_be__is_refused_and_leaves_no_event(lab, tmp_path) -> None:
    void("S1", lab, "a siren", 1, 2)
    before = events_of(lab)
    for code, reason, visit, run, trial, words in (
        ("S1", " ", 1, None, None, "no reason"),
        ("S9", "why", 1, None, None, "'S9' is not in the study"),
        ("S1", "why", 3, None, None, "visit 3 of subject 'S1' is not planned"),
        ("S1", "why", None, None, None, "has 2 visits"),
        ("S2", "why", None, 2, None, "run 2 is not of subject 'S2'"),
        ("S1", "why", 2, 2, None, "run 2 is not of subject 'S1'"),
        ("S1", "why", 1, None, 4, "trial 4 without its run"),
        ("S1", "why", None, 2, 400, "run 2 has no trial 400"),
        ("S1", "why", None, 2, None, "run 2 of visit 1 of subject 'S1' is void already"),
    ):
        with pytest.raises(BadInput, match=words):
            void(code, lab, reason, visit, run, trial)
    for mark in ("\0", "\x1b[2J", "\x85", "\udc80"):
        for refused in (
            lambda mark=mark: void("S1", lab, f"a{mark}siren", 1),
            lambda mark=mark: rename("S1", "S7", lab, f"a{mark}slip"),
            lambda mark=mark: correct("S1", lab, f"a{mark}slip", group="adult"),
            lambda mark=mark: correct("S1", lab, "a slip", group="adult", operator=f"E{mark}X"),
            lambda mark=mark: enrol("S8", lab, group=f"a{mark}dult"),
        ):
            with pytest.raises(BadInput, match=r"control character|letters, digits"):
                refused()
    with pytest.raises(BadInput, match="visit 2 of subject 'S1' is not void"):
        void("S1", lab, "why", 2, restore=True)
    assert events_of(lab) == before
    with opened_store(tmp_path / "served.db") as store:
        begin(store, ObedientClock(), PROTOCOL, trials=1)
    with pytest.raises(BadInput, match="run 1 of visit 1 is in progress"):
        void("S1", tmp_path / "served.db", "why")


def test_void__visit_that_was_not_over__asks_nothing_more(tmp_path) -> None:
    path, clock = tmp_path / "lab.db", ObedientClock()
    with opened_store(path) as store:
        session = begin(store, clock, PROTOCOL, trials=1)
        session.stop_run()
    void("S1", path, "the wrong finger")
    with opened_store(path) as store:
        assert begin(store, clock, PROTOCOL).stage == "done"
        assert begin(store, clock, PROTOCOL, subject=1).stage == "trial"
    with pytest.raises(BadInput, match="no response"):
        export(path, tmp_path / "out")


def test_erase__person_with_voids__takes_them_too(lab) -> None:
    for part in ((1,), (None, 2), (None, 3, 0)):
        void("S1", lab, "a siren", *part)
    void("S2", lab, "a siren", 1)
    erase(lab, "S1")
    with closing(Store(lab)) as store:
        assert len(rows_of(store, select(schema.void.c.id))) == 1


def test_rename__subject__is_the_same_person_everywhere_and_to_the_protocol_file(lab, tmp_path) -> None:
    before = tables(lab, tmp_path / "before")
    with opened_store(lab) as store:
        opened_study(store, ObedientClock(), TEXT)
        begin(store, ObedientClock(), TEXT, subject=1).note("seen", "")
    renamed = rename("S2", "s1", lab, "a slip", operator="EX")
    assert "S1" in " ".join(renamed.warnings)  # one letter apart for a person, none for a spreadsheet
    rename("s1", "Q7", lab, "clearer")
    after = tables(lab, tmp_path / "after")
    assert after == {name: text.replace(",S2,", ",Q7,").replace("\nS2,", "\nQ7,") for name, text in before.items()}
    events = rows(tmp_path / "after" / "events.csv")
    logged = [(row["who"], row["subject"], row["before"], row["after"], row["detail"]) for row in events if row["item"]]
    assert logged[0] == ("EX", "Q7", "S2", "s1", "a slip")
    assert {row["who"] for row in events if row["kind"] == "seen"} == {"subject Q7"}
    for code in ("S2", "s1", "S1", "Q7"):
        with pytest.raises(BadInput, match="enrolled already"):
            rename("Q7", code, lab, "why") if code in ("S1", "Q7") else rename("S1", code, lab, "why")
    for old, new, reason, words in (
        ("S9", "A", "why", "not in the study"),
        ("Q7", "A b", "why", "letters and digits"),
        ("Q7", "A", "", "no reason"),
    ):
        with pytest.raises(BadInput, match=words):
            rename(old, new, lab, reason)
    with opened_store(lab) as store:  # the file still says S2
        study = opened_study(store, ObedientClock(), TEXT)
        assert [row.subject_code for row in study.sessions()] == ["S1", "S1", "Q7", "Q7"]
        with study.editing() as opened, pytest.raises(BadInput, match="enrolled already"):
            opened.enrol(SubjectPart(code="S2"))
    erase(lab, "Q7")
    left = lab.read_bytes()
    assert not [name for name in (b"subject Q7", b'"S2"', b"clearer") if name in left]


@pytest.mark.slow
def test_postgres__void_rename_and_erase__are_as_in_a_file(lab, tmp_path) -> None:
    with closing(PostgresServer()) as server:
        place = fill(server.database("study"))
        for store in (lab, place):
            void("S1", store, "a siren", 2)
            void("S2", store, "a siren", 1, trial=None, run=runs_of(store, "S2")[1])
            rename("S2", "Zaphod", store, "clearer")
        found, expected = tables(place, tmp_path / "server"), tables(lab, tmp_path / "file")
        assert found == expected
        erased = erase(place, "Zaphod")
        assert (erased.visits, erased.runs, erased.trials) == (2, 8, 76)  # two of each visit are practice
        left = tables(place, tmp_path / "left")["trials"]
        assert left == "".join(line for line in expected["trials"].splitlines(keepends=True) if ",Zaphod," not in line)
        with closing(Store(place, must_exist=True)) as store:
            every = str([rows_of(store, select(table)) for table in schema.tables.sorted_tables])
        assert "a siren" in every
        assert not [name for name in ("Zaphod", '"S2"', "clearer") if name in every]


def runs_of(place, code):
    query = select(schema.run.c.id).select_from(schema.RUNS).where(schema.subject.c.code == code)
    with closing(Store(place, must_exist=True)) as store:
        return [row.id for row in rows_of(store, query.order_by(schema.run.c.id))]
