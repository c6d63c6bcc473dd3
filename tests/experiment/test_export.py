"""Exports: every table whole and explained, thresholds that follow from the tables alone, nothing that executes."""

import csv
import json
import math
import shutil
import sqlite3
import subprocess
import weakref
from contextlib import closing
from itertools import pairwise

import numpy as np
import pytest
from sqlalchemy import update

from tactuator.api import experiment
from tactuator.api.experiment import StoreThresholds
from tactuator.errors import BadInput
from tactuator.experiment.export import FORMS, export
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.protocol.study import Demographic
from tactuator.experiment.result.store_results import store_results
from tactuator.experiment.session.studies import Correction
from tactuator.experiment.simulated.subjects import run_study, simulated_observers
from tactuator.experiment.store import run_rows, schema
from tactuator.experiment.store.records import Answer
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import detection_runs
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, apparatus, begin, opened_study

STAIRS = 'kind = "up-down"\nstart_db_sl = 20\nsteps_db = [4, 2]\nreversals = 6\naveraged = 4'
QUESTS = 'kind = "quest-plus"\ntrials = 16'
QUICK = (
    PROTOCOL.replace(STAIRS, QUESTS).replace('experimenter = "EX"', 'experimenter = "=1+1"\nvisits = 2')
) + '[[demographic]]\nname = "age"\nlabel = "Age"\nkind = "number"\nunit = "year"\n'


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Two simulated subjects, two visits of the first, and a person who withdraws with all of it."""
    made, place = Store(tmp_path_factory.mktemp("store") / "lab.db"), apparatus()
    curve = place.controller.display.channels[0].threshold.curve
    protocol = parse_protocol(QUICK, Protocol)
    for _ in range(2):
        run_study(made, protocol, QUICK, place, simulated_observers(curve, 2, 3, place.band_hz), ObedientClock())
    text, clock = QUICK + '[[subject]]\ncode = "S3"\n', ObedientClock()
    person = begin(made, clock, text, subject=2, trials=5)
    person.withdraw(keep=False)
    study = opened_study(made, clock, text)
    with study.editing() as opened:
        for code in ("S3", "S1"):
            opened.correct(code, Correction("unknown" if code == "S1" else "hearing"), "a slip")
    yield made
    made.close()


@pytest.fixture(scope="module")
def tidy(store, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out") / "tidy"
    export(store, folder, "tidy")
    return folder


def rows(path):
    with path.open() as stream:
        return list(csv.DictReader(stream, delimiter="\t" if path.suffix == ".tsv" else ","))


def header(path):
    with path.open() as stream:
        return next(csv.reader(stream, delimiter="\t" if path.suffix == ".tsv" else ","))


def test_export__every_column_of_every_table__is_explained_and_every_trial_there(store, tidy, tmp_path) -> None:
    """What the Psych-DS validator refuses: a variable in the description that no file has (it found one here)."""
    explained = {(row["table"], row["column"]) for row in rows(tidy / "dictionary.csv") if row["description"]}
    tables = {path.stem: header(path) for path in tidy.glob("*.csv") if path.stem != "dictionary"}
    assert set(tables) == {"trials", "intervals", "events", "subjects", "thresholds"}
    assert {(name, column) for name, columns in tables.items() for column in columns} <= explained
    count = len(rows(tidy / "trials.csv"))
    assert export(store, tmp_path / "psych-ds", "psych-ds") == count > 100
    document = json.loads((tmp_path / "psych-ds" / "dataset_description.json").read_text())
    files = [*(tmp_path / "psych-ds" / "data").iterdir()]
    assert {one["name"] for one in document["variableMeasured"]} == {name for path in files for name in header(path)}
    assert sum(len(rows(path)) for path in files if "description-trials" in path.name) == count
    assert export(store, tmp_path / "bids", "bids") == count
    assert sum(len(rows(path)) for path in (tmp_path / "bids").rglob("*_beh.tsv")) == count
    for path in (tmp_path / "bids").rglob("*_beh.tsv"):
        assert set(header(path)) <= set(json.loads(path.with_suffix(".json").read_text()))
    for path in (tmp_path / "bids").rglob("*_events.tsv"):
        onsets = [float(row["onset"]) for row in rows(path)]
        assert onsets == sorted(onsets)
    assert header(tmp_path / "bids" / "participants.tsv") == ["participant_id", "subject_group", "enrolled_utc", "age"]
    described = json.loads((tmp_path / "bids" / "participants.json").read_text())
    assert described["age"] == {"Description": "Age", "Units": "year"}
    found = [json.loads(path.read_text()) for path in sorted((tidy / "settings").iterdir())]
    assert [(one["version"], one["reason"]) for one in found] == [(1, ""), (2, "subjects")]
    assert found[0]["protocol"]["procedure"] == {"kind": "quest-plus", "trials": 16}


def test_export__format_unknown_or_store_empty__is_refused(store, tmp_path) -> None:
    with pytest.raises(BadInput, match="tidy, psych-ds, bids"):
        export(store, tmp_path / "out", "spss")
    with closing(Store(tmp_path / "lab.db")) as empty:
        with pytest.raises(BadInput, match="no response"):
            export(empty, tmp_path / "out", "tidy")
        with pytest.raises(BadInput, match="no done run"):
            detection_runs(empty)
    assert not (tmp_path / "out").exists()


def test_tidy__tables__say_simulated_leave_out_who_withdrew_and_execute_nothing(tidy):
    assert {row["subject_group"] for row in rows(tidy / "trials.csv")} == {"simulated"}
    assert {row["respondent"] for row in rows(tidy / "trials.csv")} == {"simulated"}
    assert {(row["group"], row["respondent"], row["rig_simulated"]) for row in rows(tidy / "thresholds.csv")} == {
        ("simulated", "simulated", "1")
    }
    groups = {row["subject"]: row["subject_group"] for row in rows(tidy / "subjects.csv")}
    assert groups == {"S1": "simulated", "S2": "simulated"}
    of_sessions = [row for row in rows(tidy / "events.csv") if row["visit"]]
    assert {row["simulated"] for row in [*rows(tidy / "intervals.csv"), *of_sessions]} == {"simulated"}
    assert of_sessions
    for name in ("trials", "intervals", "thresholds", "subjects"):
        assert "S3" not in {row["subject"] for row in rows(tidy / f"{name}.csv")}
    events = rows(tidy / "events.csv")
    assert "withdrawn-discard" in {row["kind"] for row in events}
    assert [row["subject"] for row in events if row["item"]] == ["S1"]  # S3's correction tells data of S3
    trials = {(row["run"], row["trial"]) for row in rows(tidy / "trials.csv")}
    intervals = rows(tidy / "intervals.csv")
    assert {(row["run"], row["trial"]) for row in intervals} == trials
    assert len(intervals) == 3 * len(trials)
    for first, second in pairwise(intervals):
        if first["trial"] == second["trial"] and first["run"] == second["run"]:
            gap_s = float(second["onset_s"]) - float(first["onset_s"]) - float(first["duration_s"])
            assert gap_s == pytest.approx(0.01, abs=1 / 4000)
    assert {row["experimenter"] for row in rows(tidy / "trials.csv")} == {"'=1+1"}


def posterior_by_hand(levels, correct, settings):
    """Median, standard deviation and 95 % interval of the threshold, from trials and the side-car's prior alone."""
    where, (slope, lapse) = settings["threshold_db_sl"], (settings[name] for name in ("slope", "lapse"))
    reach, step = where["reach_db"], where["step_db"]
    threshold = np.median(levels[len(levels) // 2 :]) + np.arange(-reach, reach + step / 2, step)
    t, s, g = np.meshgrid(threshold, slope["values"], lapse["values"], indexing="ij")
    log = np.log(slope["prior"])[None, :, None] + np.log(lapse["prior"])[None, None, :] + np.zeros_like(t)
    guess = settings["guess"]
    at_threshold = -np.log(1.0 - (settings["point"] - guess) / (1.0 - guess - g))
    for level, right in zip(levels, correct, strict=True):
        rise = 1.0 - np.exp(-at_threshold * 10.0 ** (s * (level - t) / 20.0))
        chance = np.clip(guess + (1.0 - guess - g) * rise, 1e-6, 1.0 - 1e-6)
        log += np.log(chance if right else 1.0 - chance)
    each = np.exp(log - log.max())
    weight, evenly = each.sum(axis=(1, 2)), np.log((each / np.array(slope["prior"])[None, :, None]).sum(axis=(1, 2)))
    weight /= weight.sum()
    mean = weight @ threshold
    edges, reached = np.append(threshold - step / 2, threshold[-1] + step / 2), np.append(0.0, np.cumsum(weight))
    median = np.interp(0.5, reached, edges)
    fine = np.linspace(threshold[0], threshold[-1], 2_000_001)
    likely = fine[np.interp(fine, threshold, evenly) >= evenly.max() - math.log(15.0)]
    low, high = likely[0], likely[-1]
    return median, math.sqrt(weight @ (threshold - mean) ** 2), low, high


def test_tidy__thresholds__follow_from_the_exported_trials_and_side_cars_alone(tidy) -> None:
    """A refit written anew from the side-car's words, with nothing of the program."""
    trials = [row for row in rows(tidy / "trials.csv") if row["practice"] == "0" and row["run_state"] == "done"]
    table = rows(tidy / "thresholds.csv")
    assert {row["run"] for row in trials} == {row["run"] for row in table}
    for row in table:
        mine = [one for one in trials if one["run"] == row["run"]]
        assert len(mine) == int(row["trials"])
        assert {one["protocol_version"] for one in mine} == {row["protocol_version"]}
        settings = json.loads((tidy / "settings" / f"protocol-1-{row['protocol_version']}.json").read_text())["refit"]
        assert float(row["point"]) == pytest.approx(settings["point"], abs=1e-6)
        levels = np.array([float(one["level_db_sl"]) for one in mine])
        found = posterior_by_hand(levels, [one["correct"] == "1" for one in mine], settings)
        names = ("refit_db_sl", "refit_sd_db", "refit_low_db_sl", "refit_high_db_sl")
        told = [float(row[name]) if row[name] else math.nan for name in names]
        bound = ">=" if found[0] > levels.max() else "<=" if found[0] < levels.min() else ""
        low = math.nan if bound == "<=" or found[2] < levels.min() - 6.0 else min(found[2], levels.max())
        high = math.nan if bound == ">=" or found[3] > levels.max() + 6.0 else max(found[3], levels.min())
        expected = [np.clip(found[0], levels.min(), levels.max()), math.nan if bound else found[1], low, high]
        assert told == pytest.approx(expected, abs=1e-4, nan_ok=True)
        assert row["bound"] == bound
        shift = float(row["level_db_re_1um"]) - float(row["refit_db_sl"]) - float(mine[0]["curve_level_db_re_1um"])
        assert shift == pytest.approx(float(row["delivered_db"] or 0.0), abs=1e-9)


ONE_SUBJECT = QUICK[: QUICK.index('[[subject]]\ncode = "S2"')].replace("visits = 2", "visits = 1")


def test_export__same_code_in_two_studies__is_two_participants(tmp_path) -> None:
    made, place = Store(tmp_path / "lab.db"), apparatus()
    curve = place.controller.display.channels[0].threshold.curve
    for name in ("one", "an other"):
        text = ONE_SUBJECT.replace('"short"', f'"{name}"').replace("[30, 90, 210]", "[210]")
        people = simulated_observers(curve, 1, 3, place.band_hz)
        run_study(made, parse_protocol(text, Protocol), text, place, people, ObedientClock())
    for form in ("psych-ds", "bids"):
        export(made, tmp_path / form, form)
        files = sorted((tmp_path / form).rglob("*_beh.tsv" if form == "bids" else "*description-trials_data.csv"))
        assert len(files) >= 2
        for path in files:
            assert {row["study"] for row in rows(path)} == {"an other" if "another" in path.name else "one"}
    made.close()
    participants = [row["participant_id"] for row in rows(tmp_path / "bids" / "participants.tsv")]
    assert participants == ["sub-anotherS1", "sub-oneS1"]


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("bids-validator-deno") is None, reason="the validator is not installed")
def test_bids__its_own_validator__finds_no_error(store, tmp_path) -> None:
    export(store, tmp_path / "bids", "bids")
    done = subprocess.run(
        ["bids-validator-deno", "--json", str(tmp_path / "bids")], capture_output=True, text=True, check=False
    )
    issues = json.loads(done.stdout)["issues"]["issues"]
    assert [one for one in issues if one["severity"] == "error"] == []


def test_trials__times__are_of_page_and_server(tmp_path) -> None:
    clock, made = ObedientClock(), Store(tmp_path / "lab.db")
    presented = begin(made, clock)
    following = presented.present(lambda interval, begins: None)
    clock.wait(1.5)
    answer = Answer(following.trial.correct, clock.utc(), 100.0, 900.0, (10.0, 60.0, 110.0), clock.monotonic_s())
    presented.answer(answer)
    export(made, tmp_path / "out", "tidy")
    (trial,) = rows(tmp_path / "out" / "trials.csv")
    assert [float(trial[name]) for name in ("response_time", "server_response_time")] == [0.8, 1.5]
    assert (trial["rig_rate_hz"], trial["presentations"], trial["respondent"]) == ("4000.0", "1", "person")
    lit = [float(row["client_lit_ms"]) for row in rows(tmp_path / "out" / "intervals.csv")]
    assert lit == [10.0, 60.0, 110.0]
    assert not math.isnan(float(trial["rig_tick"]))
    opened_study(made, clock)
    made.close()


BROKEN = ONE_SUBJECT.replace('"short"', '"broken"').replace("[30, 90, 210]", "[210]")
UNREADABLE = {"kind": ('kind = "quest-plus"', 'kind = "no-such-package"'), "text": ("[study]", "[study")}
AT_CHANCE = {"chance": (QUESTS, 'kind = "up-down"\ndown = 1\n[paradigm]\nintervals = 2')}


@pytest.fixture(scope="module")
def answered(tmp_path_factory):
    """Return a function that opens a store in which one simulated subject has gone through each protocol: its own copy
    of one that was made once.
    """
    folder, stores = tmp_path_factory.mktemp("answered"), {}

    def opened(path, *texts):
        if texts not in stores:
            stores[texts] = folder / f"{len(stores)}.db"
            with closing(Store(stores[texts])) as made:
                for text in texts:
                    place = apparatus()
                    curve = place.controller.display.channels[0].threshold.curve
                    people = simulated_observers(curve, 1, 3, place.band_hz)
                    run_study(made, parse_protocol(text, Protocol), text, place, people, ObedientClock())
        shutil.copy(stores[texts], path)
        return Store(path)

    return opened


def tables_of(folder, study):
    """The rows of a study in every table, as text, without the numbers that the store gives."""
    own = ("run", "received_utc")
    return {
        path.stem: [{k: v for k, v in row.items() if k not in own} for row in rows(path) if row["study"] == study]
        for path in sorted(folder.glob("*.csv"))
        if path.stem != "dictionary"
    }


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("change", [*(UNREADABLE | AT_CHANCE).values()], ids=[*(UNREADABLE | AT_CHANCE)])
def test_export__one_study_cannot_be_refitted__keeps_its_trials_and_leaves_the_others_as_they_are(
    tmp_path, change, first, answered
) -> None:
    with closing(answered(tmp_path / "alone.db", ONE_SUBJECT)) as alone:
        export(alone, tmp_path / "alone", "tidy")
    texts = (BROKEN, ONE_SUBJECT) if first else (ONE_SUBJECT, BROKEN)
    with closing(answered(tmp_path / "lab.db", *texts)) as both:
        with both.begin() as connection:
            version = schema.protocol_version
            broken = BROKEN.replace(*change)
            assert broken != BROKEN
            connection.execute(update(version).where(version.c.toml == BROKEN).values(toml=broken))
        for form in FORMS:
            assert export(both, tmp_path / form, form) == 68
    assert tables_of(tmp_path / "tidy", "short") == tables_of(tmp_path / "alone", "short")
    assert len(tables_of(tmp_path / "tidy", "broken")["trials"]) == 18
    without = tables_of(tmp_path / "tidy", "broken")["thresholds"]
    assert [row["flags"] for row in without] == ["no-refit"]
    assert not any(row["refit_db_sl"] for row in without)
    (said,) = StoreThresholds(store_results(tmp_path / "lab.db")).notices()
    assert said.startswith("no threshold of run ")
    assert "broken" in said or change in AT_CHANCE.values()


def test_figures__of_more_people_than_are_drawn__are_of_the_first_alone(
    tmp_path, answered, monkeypatch, capsys
) -> None:
    answered(tmp_path / "lab.db", ONE_SUBJECT, BROKEN).close()
    monkeypatch.setattr(experiment, "_PEOPLE_DRAWN", 1)
    for _ in range(2):  # the second time over the first
        experiment.thresholds(tmp_path / "lab.db", figures=tmp_path / "figures")
    assert {path.stem for path in (tmp_path / "figures").iterdir()} == {"fig11", "psychometric-S1-1"}
    assert "1 of 2 subjects are drawn" in capsys.readouterr().err


FACTS = """
[[demographic]]
name = "pta"
label = "Hearing level"
kind = "number"
[[demographic]]
name = "note"
label = "Note"
"""


def test_subjects__facts_of_any_content__have_the_types_of_their_items(tmp_path) -> None:
    """Numbers are numbers however they were typed, and what is text stays text that nothing executes."""
    given = [("-5", "-5 dB"), ("0,5", "=1+1"), ("\u0663\u0665", "007"), ("1e2", "a,b"), ("-0.125", 'a "b"')]
    people = "".join(f'[[subject]]\ncode = "P{at}"\n' for at in range(len(given)))
    text = ONE_SUBJECT[: ONE_SUBJECT.index("[[subject]]")] + people + FACTS
    with closing(Store(tmp_path / "lab.db")) as store:
        study = opened_study(store, ObedientClock(), text)
        for at, (number, note) in enumerate(given):
            with study.editing() as opened:
                opened.correct(f"P{at}", Correction(facts={"pta": number, "note": note}), "as noted")
        begin(store, ObedientClock(), text, trials=1)
        export(store, tmp_path / "tidy", "tidy")
    table = rows(tmp_path / "tidy" / "subjects.csv")
    assert [row["pta"] for row in table] == ["-5", "0.5", "35", "100", "-0.125"]
    assert [row["note"] for row in table] == ["'-5 dB", "'=1+1", "007", "a,b", 'a "b"']
    after = [row["after"] for row in rows(tmp_path / "tidy" / "events.csv") if row["item"] == "pta"]
    assert after == ["-5", "0.5", "35", "100", "-0.125"]


@pytest.mark.parametrize("typed", ["1,234", "0,5,1", "1_000", "1 000", "nan", "inf", "5dB", ""])
def test_fact__no_number_or_one_with_two_meanings__is_refused_by_its_name(typed) -> None:
    with pytest.raises(BadInput) as refused:
        Demographic(name="pta", label="Hearing level", kind="number").take(typed)
    assert "pta" in (refused.value.key, *refused.value.where)


@pytest.mark.parametrize("form", FORMS)
def test_export__larger_store__holds_no_more_rows_at_a_time(tmp_path, monkeypatch, answered, form) -> None:
    """Rows are counted where they are fetched, with those of runs that are still held then."""
    held, most = weakref.WeakSet(), [0]
    fetched, made = run_rows.plain_rows, run_rows.RunRows

    def counted(connection, query):
        rows = [*fetched(connection, query)]
        most[0] = max(most[0], len(rows) + sum(len(run.trials) + len(run.intervals) for run in held))
        return iter(rows)

    def registered(*of_run):
        run = made(*of_run)
        held.add(run)
        return run

    monkeypatch.setattr(run_rows, "AT_ONCE", 40)
    monkeypatch.setattr(run_rows, "plain_rows", counted)
    monkeypatch.setattr(run_rows, "RunRows", registered)
    texts = [ONE_SUBJECT.replace('"short"', f'"{name}"').replace("[30, 90, 210]", "[210]") for name in "abcdefgh"]
    with closing(answered(tmp_path / "lab.db", *texts)) as store:
        assert export(store, tmp_path / form, form) == 18 * len(texts)
    # a trial has three intervals; a run of at most 18 trials is held while the next ones are read
    assert 0 < most[0] <= 4 * (40 + 18) < 4 * 18 * len(texts) / 2


_OTHERS = """
INSERT INTO stimulus (study_id, label, source, sha256, duration_s) VALUES (1, 'a', 'a', 'a', 1);
INSERT INTO response_option (study_id, position, label, key) VALUES (1, 0, 'a', 'a');
INSERT INTO event (session_id, at_utc, who, kind, trials, detail) VALUES (1, '2026', '', 'break', 3, '');
"""


@pytest.mark.slow
@pytest.mark.parametrize("value", ["abc", b"\xff\x00", None])
def test_store__cell_of_another_type_in_any_column__is_refused_by_its_name(tmp_path, answered, value) -> None:
    """What may be empty is, and is read; NOT NULL is taken from the tables, as damage does not keep to it."""
    answered(tmp_path / "sound.db", ONE_SUBJECT.replace("[30, 90, 210]", "[210]")).close()
    with closing(sqlite3.connect(tmp_path / "sound.db")) as plain, plain:
        plain.executescript(_OTHERS)
        columns = plain.execute(
            """SELECT m.name, c.name, c."notnull" FROM sqlite_master AS m JOIN pragma_table_info(m.name) AS c
            WHERE m.type = 'table' AND m.name <> 'schema_version' AND NOT c.pk AND (c.type <> 'VARCHAR' OR ?)""",
            (isinstance(value, bytes),),
        ).fetchall()
    named = 0
    for table, name, needed in columns:
        path, refused = tmp_path / "lab.db", ""
        shutil.copy(tmp_path / "sound.db", path)
        with closing(sqlite3.connect(path)) as plain, plain:
            plain.execute("PRAGMA writable_schema = ON")
            plain.execute("UPDATE sqlite_master SET sql = replace(sql, 'NOT NULL', '') WHERE name = ?", (table,))
        with closing(sqlite3.connect(path)) as plain, plain:
            plain.execute("PRAGMA ignore_check_constraints = ON")
            changed = plain.execute(f'UPDATE "{table}" SET "{name}" = ? WHERE rowid = 1', (value,)).rowcount
        try:
            with closing(Store(path, must_exist=True)) as store:
                export(store, tmp_path / "out", "tidy")
            store_results(path)
        except BadInput as error:
            refused = str(error)
        is_named = "damaged" in refused and (
            f"{table}.{name};" in refused or f"CHECK constraint failed in {table}" in refused
        )
        assert is_named == bool(changed and (value is not None or needed)), (table, name, refused)
        named += is_named
    assert named > 20
