"""The verb `experiment`: one JSON object, or one line and status 2."""

import io

import pytest

from tactuator.experiment.protocol.file import parse_recognition
from tactuator.experiment.protocol.recognition import block_trials
from tests.experiment.session.apparatuses import PROTOCOL
from tests.experiment.session.recognising import controller, items, protocol_text  # noqa: F401

SHORT = PROTOCOL.replace("reversals = 6", "reversals = 4").replace("averaged = 4", "averaged = 2")
STORE = ("--store", "lab.db")


@pytest.mark.parametrize(
    ("arguments", "keys"),
    [
        ("imece2004 --runs 50 --lapse 0.01 --start-db 16", {"sd_db", "trials_p05"}),
        ("quest-plus --runs 20 --trials 20 --slope 1.5:3.5", {"sd_db", "refit"}),
        ("curve --runs 2 --trials 20", {"rms_error_db", "coverage95"}),
    ],
)
def test_simulate__json__is_one_object(run, arguments, keys) -> None:
    answer = run.json("experiment", "simulate", "--procedure", *arguments.split(), "--seed", "3")
    assert keys | {"simulated"} <= set(answer)


def test_observe_thresholds_export__in_turn__give_files_and_objects(desk, run) -> None:
    (desk / "protocol.toml").write_text(SHORT)
    observe = ("experiment", "observe", "protocol.toml", *STORE, "--seed", "4")
    assert [row["simulated"] for row in run.json(*observe)["truth"]] == ["simulated"] * 6
    assert "nothing left to do, all have gone through the study: lab.db" in run(*observe).out
    judged = "the store holds short; allowed: a study in which tones are judged"
    run.refused("experiment", "judged", "lab.db", said=judged)
    thresholds = ("experiment", "thresholds", *STORE)
    results = run.json(*thresholds, "--curve-out", "curve.csv", "--figures", "figures")
    assert (len(results["thresholds"]), len(results["curve"])) == (6, 5)
    assert "bound" in (desk / "curve.csv").read_text().splitlines()[3]
    assert (desk / "figures" / "fig11.svg").exists()
    assert run.json("experiment", "export", *STORE, "--format", "bids", "--out", "bids")["trials"] > 50
    run.refused(*thresholds, "--group", "unknown", said="unknown")


def test_thresholds__curve_of_two_frequencies__table_then_the_refusal(desk, run) -> None:
    (desk / "protocol.toml").write_text(
        SHORT.replace("[30, 90, 210]", "[30, 90]").partition('[[subject]]\ncode = "S2"')[0]
    )
    ended = run("experiment", "observe", "protocol.toml", *STORE, "--seed", "4", "--json")
    assert "no curve: frequencies_hz has 2; allowed: 3 or more" in ended.err
    ended = run("experiment", "thresholds", *STORE, "--curve-out", "curve.csv")
    assert ended.status == 2
    assert "S1" in ended.out
    assert "written" not in ended.out
    assert ended.err == "tactuator: a curve of 2 measured frequencies; allowed: three or more\n"
    assert not (desk / "curve.csv").exists()
    assert run("experiment", "thresholds", *STORE, "--figures", "figures").status == 0
    assert (desk / "figures" / "fig11.svg").exists()


@pytest.fixture
def words(desk, items):
    """A folder with items, a recognition protocol and a controller; work goes on in it."""
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
    right = [trial.correct for trial in block_trials(parse_recognition(text), 0, 0)]
    keys = {item.label: item.key for item in parse_recognition(text).item}
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


@pytest.mark.parametrize("rig", ["simulated", "in-process"])
def test_recognise__abx_by_script__on_any_rig_with_a_name(words, run, rig) -> None:
    (words / "words.toml").write_text(protocol_text("abx", training=0, test=1))
    run.refused(*RECOGNISE, "--subject", "S9", "--scripted-error", "0", said="subject 'S9' is not in the study")
    answered = run.json(*RECOGNISE, "--rig", rig, "--scripted-error", "0")
    assert (answered["trials"], answered["simulated"]) == (12, True)
    (abx,) = run.json("experiment", "information", *STORE)["abx"]
    assert (abx["share_correct"], abx["simulated"]) == (1.0, True)
    assert "simulated: nobody felt this" in " ".join(run("experiment", "information", *STORE).out.split())
