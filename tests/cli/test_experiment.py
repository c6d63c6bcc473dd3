"""`experiment` and the verbs of speech: one JSON object, or one line; subjects held against the store's rows."""

import csv
import io

import numpy as np
import pytest
import soundfile
from sqlalchemy import select

from tactuator.experiment.protocol.file import RecognitionProtocol, parse_protocol
from tactuator.experiment.protocol.recognition import block_trials
from tactuator.experiment.simulated import subjects
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store, sessions_of
from tactuator.io.reference import open_reference
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, answer_one, begin
from tests.experiment.session.recognising import controller, items, protocol_text  # noqa: F401

SHORT = PROTOCOL.replace("reversals = 6", "reversals = 4").replace("averaged = 4", "averaged = 2")
STORE = ("--store", "lab.db")


def test_simulate__json__is_one_object(run) -> None:
    how = ("--procedure", "quest-plus", "--runs", "20", "--trials", "20", "--seed", "3")
    answer = run.json("experiment", "simulate", *how)
    assert {"sd_db", "refit", "simulated"} <= set(answer)


def test_simulate_and_observe__truth_that_ends_within_the_band__is_told(desk, run) -> None:
    (desk / "protocol.toml").write_text(SHORT)
    simulate = "simulate --procedure curve --runs 2 --trials 20 --truth loss.csv"
    observe = "observe protocol.toml --store lab.db --truth S1=loss.csv"
    for rows, told in (("0.4,0\n250,30\n", True), ("0.4,0\n300,30\n", False)):
        (desk / "loss.csv").write_text(f"frequency_hz,level_db_sl\n{rows}")
        for verb in (simulate, observe):
            err = run("experiment", *verb.split()).err
            assert ("loss.csv covers 0.4 to 250 Hz of 0.4 to 300 Hz: beyond, the level" in err) == told


def test_observe_thresholds_export__in_turn__give_files_and_objects(desk, run) -> None:
    (desk / "protocol.toml").write_text(SHORT)
    observe = ("experiment", "observe", "protocol.toml", *STORE, "--seed", "4")
    assert [row["simulated"] for row in run.json(*observe)["truth"]] == ["simulated"] * 6
    again = " ".join(run(*observe).out.split())
    assert "nothing left to do, all have gone through the study (nobody felt this)" in again
    judged = "the store holds short; expected a study in which tones are judged"
    run.refused("experiment", "judged", "lab.db", said=judged)
    thresholds = ("experiment", "thresholds", *STORE)
    results = run.json(*thresholds, "--curve-out", "curve.csv", "--figures", "figures")
    assert (len(results["thresholds"]), len(results["curve"])) == (6, 5)
    assert "bound" in (desk / "curve.csv").read_text().splitlines()[3]
    assert (desk / "figures" / "fig11.svg").exists()
    assert run.json("experiment", "export", *STORE, "--format", "bids", "--out", "bids")["trials"] > 50
    run.refused(*thresholds, "--group", "unknown", said="unknown")


def test_observe__interrupted__says_where_the_trials_until_then_are(desk, run, monkeypatch) -> None:
    def stop(at: int, share: float) -> None:
        raise KeyboardInterrupt

    (desk / "protocol.toml").write_text(SHORT)
    monkeypatch.setattr(
        "tactuator.api.experiment.run_study", lambda *given, of=subjects.run_study: of(*given[:-1], stop)
    )
    ended = run("experiment", "observe", "protocol.toml", *STORE)
    assert (ended.status, ended.err) == (130, "tactuator: interrupted; written: lab.db\n")


def test_thresholds__curve_of_two_frequencies__table_then_the_refusal(desk, run) -> None:
    (desk / "protocol.toml").write_text(
        SHORT.replace("[30, 90, 210]", "[30, 90]").partition('[[subject]]\ncode = "S2"')[0]
    )
    ended = run("experiment", "observe", "protocol.toml", *STORE, "--seed", "4", "--json")
    assert "no curve: frequencies_hz has 2; expected 3 or more" in ended.err
    ended = run("experiment", "thresholds", *STORE, "--curve-out", "curve.csv")
    assert ended.status == 2
    assert "subjects: 1" in ended.out
    assert "written" not in ended.out
    assert ended.err == "tactuator: a curve of 2 measured frequencies; expected three or more\n"
    assert not (desk / "curve.csv").exists()
    assert run("experiment", "thresholds", *STORE, "--figures", "figures").status == 0
    assert (desk / "figures" / "fig11.svg").exists()


@pytest.fixture
def words(desk, items):
    for path in items.iterdir():
        (desk / path.name).symlink_to(path)
    return desk


RECOGNISE = ("experiment", "recognise", "words.toml", *STORE, "--controller", "controller.json")


def typed(monkeypatch, *lines: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


def test_recognise__at_the_terminal__asks_consent_introduces_tells_and_breaks(words, run, monkeypatch) -> None:
    text = protocol_text(training=1, test=1, consent="You may stop.")
    (words / "words.toml").write_text(text)
    typed(monkeypatch, "n")
    assert run.json(*(word.replace("lab.db", "no.db") for word in RECOGNISE))["trials"] == 0
    right = [trial.correct for trial in block_trials(parse_protocol(text, RecognitionProtocol), 0, 0)]
    keys = {item.label: item.key for item in parse_protocol(text, RecognitionProtocol).item}
    wrong = next(key for label, key in keys.items() if label != right[1])
    typed(monkeypatch, "y", keys[right[0]], "9", wrong, keys[right[2]], "", "1", "1", "1")
    ended = run(*RECOGNISE, "--json")
    assert ended.out == '{"subject": "S1", "trials": 6, "store": "lab.db", "simulated": true}\n', ended.err
    order = [
        "You may stop.",
        "Block 1 of 2: training, 3 trials.",
        "right",
        "'9' is no key of these",
        f"it was {right[1]}",
        "Time for a break",
        "Block 2 of 2: test, 3 trials.",
    ]
    assert [place for place in map(ended.err.find, order) if place >= 0] == sorted(map(ended.err.find, order))


def test_recognise__abx_by_script__on_any_rig_with_a_name(words, run) -> None:
    (words / "words.toml").write_text(protocol_text("abx", training=0, test=1))
    run.refused(*RECOGNISE, "--subject", "S9", "--scripted-error", "0", said="subject 'S9' is not in the study")
    answered = run.json(*RECOGNISE, "--rig", "in-process", "--scripted-error", "0")
    assert (answered["trials"], answered["simulated"]) == (12, True)
    (abx,) = run.json("experiment", "information", *STORE)["abx"]
    assert (abx["share_correct"], abx["simulated"]) == (1.0, True)
    assert "simulated: nobody felt this" in " ".join(run("experiment", "information", *STORE, "--full").out.split())


AGE = '[[demographic]]\nname = "age"\nlabel = "Age"\nkind = "number"\nhigh = 120\n\n'
ASKED = PROTOCOL.replace("[[subject]]", AGE + "[[subject]]", 1)
ENROL, CORRECT = ("experiment", "enrol"), ("experiment", "correct")


@pytest.fixture
def lab(desk):
    store, clock = Store(desk / "lab.db"), ObedientClock()
    answer_one(begin(store, clock, ASKED), clock)
    store.close()
    return desk / "lab.db"


def rows(path):
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
    said = run(*CORRECT, "S1", "--reason", "given", "--participant-id", "007", *STORE).err
    assert "warning: 007 is the number 7" in said


AMISS = {
    "enrol S9 --fact age": "--fact 'age'; expected NAME=VALUE",
    "enrol S1 --visit --group hearing": "--visit with facts of a new subject; expected --visit alone",
    "correct S1 --reason why --preload-n -1": "subject: preload_n is -1; it must be a number of 0 or more",
}
RUNNING = "its sessions are run by process"


def test_enrol_and_correct__bad_input__is_one_line_and_changes_nothing(lab, run) -> None:
    before = rows(lab)
    for command, words in AMISS.items():
        run.refused("experiment", *command.split(), *STORE, said=words)
    with sessions_of(lab):
        run.refused(*ENROL, "S9", *STORE, said=RUNNING)
        run.refused(*CORRECT, "S1", "--reason", "why", "--group", "unknown", *STORE, said=RUNNING)
    assert rows(lab) == before


RENDER = ("render", "speech.wav", "--controller", "controller.json", "--out")
WAVEFORMS = ("experiment", "waveforms", "--out", "set", "--fingers", "index", "--duration", "0.125")
WITH = ("--controller", "controller.json")


def test_render__sample__reference_felt_picture_and_figures(desk, run) -> None:
    before = set(desk.iterdir())
    more = ("--felt", "f.wav", "--figures", "figures", "--save-coding", "c.toml")
    figures = run.json(*RENDER, "n.wav", *more)
    assert figures["limiter"]["index"]["max_reduction_db"] == 0.0
    written = {path.name for path in set(desk.iterdir()) - before}
    assert written == {"c.toml", "f.json", "f.wav", "figures", "n.json", "n.wav"}
    assert sorted(path.suffix for path in (desk / "figures").iterdir()) == [".csv", ".svg"]
    assert run.json(*RENDER, "n2.wav", "--coding", "c.toml")["sha256"] == figures["sha256"]
    played = run.json("play", "n.wav", *WITH)
    assert played["played_s"] == pytest.approx(played["duration_s"])
    assert not played["stopped"]


def test_render__display_file_and_stereo__designs_for_it_and_mixes(desk, run) -> None:
    samples, rate = soundfile.read("speech.wav")
    soundfile.write("two.wav", np.stack([samples, samples], axis=1), rate)
    figures = run.json("render", "two.wav", "--out", "n.h5", "--display", "display.toml")
    assert open_reference("n.h5").frames == figures["frames"]
    assert figures["notes"] == ["2 channels mixed down to one (their mean)"]


def test_render__folder_with_a_bad_file__the_rest_done_and_status_1(desk, run) -> None:
    (desk / "speech").mkdir()
    (desk / "speech.wav").rename(desk / "speech" / "good.wav")
    (desk / "speech" / "bad.wav").write_text("words")
    (desk / "speech" / "call.m4a").write_text("of a telephone")
    words = ("render", "speech", "--out", "out", "--workers", "1", *WITH)
    figures = run.json(*words, status=1)
    assert [failure["source"] for failure in figures["failures"]] == ["bad.wav"]
    assert [(file["source"], file["kept"]) for file in figures["files"]] == [("good.wav", False)]
    assert figures["left_out"] == ["call.m4a"]
    (desk / "speech" / "bad.wav").unlink()
    told = run(*words)
    assert (told.status, "left out, since they are no source: 1 .m4a" in told.err) == (0, True)
    assert run.json(*words)["files"][0]["kept"]


def test_waveforms_recognise_information__from_nothing_to_bits(desk, run) -> None:
    figures = run.json(*WAVEFORMS, "--repetitions", "4", *WITH)
    assert len(figures["items"]) == 7
    recognise = ("experiment", "recognise", figures["protocol"], "--store", "lab.db", "--scripted-error", "0.1")
    assert run.json(*recognise, *WITH)["trials"] == 7 * (2 + 4)
    assert run.json(*recognise, "--display", "display.toml")["trials"] == 0  # designed for it; all is done
    (result,) = run.json("experiment", "information", "--store", "lab.db")["results"]
    assert result["trials"] == 28
    assert result["estimates"]["plug_in"]["bits"] > 1.5
    assert result["bits_per_second"]["plug_in"] == pytest.approx(result["estimates"]["plug_in"]["bits"] / 0.125)
    assert "5 a cell" in result["warning"]
