"""Studies that cannot come to results are refused before anyone sits down; unusual ones that can are not."""

import math
from contextlib import closing
from functools import partial

import numpy as np
import pytest

from tactuator.api.experiment import check_protocol
from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Practice
from tactuator.experiment.procedure.up_down import UpDown
from tactuator.experiment.protocol.codes import taken_for
from tactuator.experiment.protocol.file import StudyProtocol, parse_protocol
from tactuator.experiment.session.studies import open_study, task_of
from tactuator.experiment.store import schema
from tactuator.experiment.store.store import Store
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, apparatus, rows_of, token

STAIRS = 'kind = "up-down"\nstart_db_sl = 20\nsteps_db = [4, 2]\nreversals = 6\naveraged = 4'
AT = "frequencies_hz = [30, 90, 210]"
UP_DOWN = 'kind = "up-down"\n'
JUDGING = """
[study]
name = "least differences"
seed = 1
[task]
kind = "discrimination"
of = "{of}"
fingers = {fingers}
frequencies_hz = [90]
intervals = {intervals}
[task.procedure]
{rule}
[[subject]]
code = "S1"
"""
TASKED = """
[study]
name = "judged"
seed = 1
[task]
{task}
[[subject]]
code = "S1"
"""
RECOGNISING = """
[study]
name = "vowels"
seed = 1
[[item]]
label = "a"
file = "a.wav"
key = "a"
[[item]]
label = "i"
file = "i.wav"
key = "i"
[[block]]
kind = "training"
repetitions = {repetitions}
criterion = {criterion}
[[subject]]
code = "S1"
"""


def ruled(rule: str, intervals: int = 3, **others: str) -> str:
    text = PROTOCOL.replace(STAIRS, rule) + f"[paradigm]\nintervals = {intervals}\n"
    for old, new in others.items():
        line = {"at": AT, "practice": "practice_trials = 2", "end": "[paradigm]"}[old]
        assert line in text
        text = text.replace(line, new)
    return text


def tasked(kind: str, *lines: str) -> str:
    return TASKED.format(task="\n".join((f'kind = "{kind}"', *lines)))


MAGNITUDES = partial(tasked, "magnitude-estimation", 'finger = "index"')
PAIRS = partial(tasked, "matching", 'finger = "index"', 'method = "pairs"')
FREQUENCIES = partial(tasked, "discrimination", 'of = "frequency"', 'fingers = ["index"]')


def practised(text: str) -> str:
    return ruled(UP_DOWN, practice=text)


def judging(rule: str, intervals: int = 3, of: str = "amplitude", fingers: str = '["index"]') -> str:
    return JUDGING.format(rule=rule, intervals=intervals, of=of, fingers=fingers)


REQUIRED = '[[demographic]]\nname = "pta"\nlabel = "Hearing level"\nkind = "number"\nrequired = true\n'
UNWORKABLE = {
    "two intervals, 1 down 1 up": (ruled(UP_DOWN + "down = 1", 2), "50.00 %"),
    "two intervals, 2 down 2 up": (ruled(UP_DOWN + "down = 2\nup = 2", 2), "50.00 %"),
    "three intervals, 1 down 2 up": (ruled(UP_DOWN + "down = 1\nup = 2"), "29.29 %"),
    "nine intervals, 1 down 7 up": (ruled(UP_DOWN + "down = 1\nup = 7", 9), "9.43 %"),
    "yes or no, more false alarms than yes": (
        ruled(UP_DOWN + "down = 1\nup = 2", 1, end="[paradigm]\nfalse_alarms = 0.3"),
        "29.29 %",
    ),
    "20 down 1 up": (ruled(UP_DOWN + "down = 20"), "96.59 %"),
    "fifteen reversals in twenty trials": (ruled(UP_DOWN + "trial_limit = 20"), "trial_limit"),
    "four trials": (ruled(UP_DOWN + "reversals = 1\naveraged = 1\ntrial_limit = 4"), "4 trials at most"),
    "QUEST+ of three trials": (ruled('kind = "quest-plus"\ntrials = 3'), "3 trials at most"),
    "a curve of four trials": (ruled('kind = "curve"\ntrials = 4', at=""), "4 trials at most"),
    "steps as wide as the levels": (
        ruled(UP_DOWN + "floor_db_sl = 0\nceiling_db_sl = 30\nsteps_db = [20]"),
        "levels over 30 dB",
    ),
    "practice that nobody feels": (
        practised("practice_trials = 6\npractice_correct = 5\npractice_level_db_sl = -20"),
        "session.practice_correct",
    ),
    "practice without a slip": (
        practised("practice_trials = 100\npractice_correct = 100\npractice_limit = 100"),
        "session.practice_correct",
    ),
    "a first level that the display does not play": (
        ruled(UP_DOWN + "start_db_sl = 54", at="frequencies_hz = [250]"),
        "at 250 Hz",
    ),
    "practice that the display does not play": (
        practised("practice_trials = 2\npractice_level_db_sl = 54").replace(AT, "frequencies_hz = [250]"),
        "practice of 54 dB SL at 250 Hz",
    ),
    "a frequency of the mains": (ruled(UP_DOWN, at="frequencies_hz = [60]"), "mains line at 60 Hz"),
    "levels that the display does not play": (
        ruled('kind = "quest-plus"\nlow_db_sl = 53\nhigh_db_sl = 55', at="frequencies_hz = [250]"),
        "at 250 Hz",
    ),
    "breaks after which a run begins again": (
        practised("practice_trials = 0\nbreak_s = 601"),
        "session.break_s",
    ),
    "two intervals of strength, 1 down 1 up": (judging(UP_DOWN + "down = 1", 2), "50.00 %"),
    "order of onsets, 1 down 1 up": (judging(UP_DOWN + "down = 1", 3, "order", '["index", "thumb"]'), "50.00 %"),
    "differences of a whole curve": (judging('kind = "curve"'), "task.procedure"),
    "levels above all people": (ruled(UP_DOWN + "start_db_sl = 40\nfloor_db_sl = 38"), "lowest level is 38 dB"),
    "levels of a curve below all people": (
        ruled('kind = "curve"\nfloor_db_sl = -60\nceiling_db_sl = -50', at=""),
        "highest level is -50 dB",
    ),
    "levels of QUEST+ below all people": (
        ruled('kind = "quest-plus"\nlow_db_sl = -30\nhigh_db_sl = -20'),
        "highest level is -20 dB",
    ),
    "a track that begins and ends below all people": (
        ruled(UP_DOWN + "start_db_sl = -20\nceiling_db_sl = -15"),
        "highest level is -15 dB",
    ),
    "differences that nobody notices": (
        judging('kind = "quest-plus"\nlow_db_sl = -30\nhigh_db_sl = -20'),
        "highest level is -20 dB",
    ),
    "magnitudes that the display does not play": (
        MAGNITUDES("frequencies_hz = [250]", "levels_db_sl = [20, 54]"),
        "tone of 54 dB SL at 250 Hz",
    ),
    "magnitudes that nobody feels": (
        MAGNITUDES("frequencies_hz = [90]", "levels_db_sl = [-50, 20]"),
        "-50 dB SL at 90",
    ),
    "magnitudes of one level": (MAGNITUDES("frequencies_hz = [90]", "levels_db_sl = [20, 20]"), "2 times"),
    "a comparison that the display does not play": (
        PAIRS("levels_db_sl = [54]", "comparisons_hz = [300]"),
        "tone of 54 dB SL at 300 Hz",
    ),
    "contours that the display does not play": (
        tasked("matching", 'finger = "index"', "levels_db_sl = [54]"),
        "tone of 54 dB SL at 298",
    ),
    "no stronger tone": (
        tasked(
            "discrimination", 'of = "amplitude"', 'fingers = ["index"]', "frequencies_hz = [300]", "levels_db_sl = [50]"
        ),
        "0.",
    ),
    "no higher tone": (FREQUENCIES("frequencies_hz = [299]"), "0.334 % at most"),
}
BEYOND_BAND = {
    "magnitudes": MAGNITUDES("frequencies_hz = [90, 900]"),
    "pairs": PAIRS("comparisons_hz = [900]"),
    "discrimination": FREQUENCIES("frequencies_hz = [900]"),
    "detection": ruled(UP_DOWN, at="frequencies_hz = [900]"),
}
USUAL_OR_NOT = {
    "yes or no, 1 down 1 up": ruled(UP_DOWN + "down = 1", 1),
    "two intervals, 3 down 1 up": ruled(UP_DOWN, 2),
    "nine intervals, 1 down 1 up": ruled(UP_DOWN + "down = 1", 9),
    "three intervals, 1 down 1 up": ruled(UP_DOWN + "down = 1"),
    "five intervals, 1 down 2 up": ruled(UP_DOWN + "down = 1\nup = 2", 5),
    "16 down 1 up": ruled(UP_DOWN + "down = 16\nreversals = 4\naveraged = 2"),
    "one reversal": ruled(UP_DOWN + "reversals = 1\naveraged = 1"),
    "steps of a quarter decibel": ruled(UP_DOWN + "steps_db = [8, 4, 2, 0.25]"),
    "QUEST+ of eight trials": ruled('kind = "quest-plus"\ntrials = 8'),
    "a curve in two intervals": ruled('kind = "curve"', 2, at=""),
    "patients from 50 dB SL": ruled(UP_DOWN + "start_db_sl = 50"),
    "limits on both sides": ruled(UP_DOWN + "floor_db_sl = 8\nceiling_db_sl = 30\ntrial_limit = 120"),
    "breaks as long as runs wait": practised("practice_trials = 0\nbreak_s = 600"),
    "long breaks between runs": practised("break_between_runs = true\nbreak_s = 3600").replace(
        "break_after_trials = 20", "break_after_trials = 1000"
    ),
    "practice of twenty right": practised("practice_trials = 20\npractice_correct = 20\npractice_limit = 20"),
    "two intervals of frequency, 2 down 1 up": judging(UP_DOWN + "down = 2\nstart_db_sl = 30", 2, "frequency"),
    "magnitudes at threshold": MAGNITUDES("frequencies_hz = [90]", "levels_db_sl = [-5, 0, 5]"),
    "contours up to 50 dB SL": tasked("matching", 'finger = "index"'),
}


@pytest.mark.parametrize(("text", "words"), [*UNWORKABLE.values()], ids=[*UNWORKABLE])
def test_open_study__that_cannot_come_to_results__is_refused_and_enrols_nobody(tmp_path, text, words) -> None:
    (tmp_path / "protocol.toml").write_text(text)
    result = check_protocol(tmp_path / "protocol.toml")
    assert not result.holds
    assert any(words in str(fault) for fault in result.faults)
    protocol = parse_protocol(text, StudyProtocol)
    with closing(Store(tmp_path / "lab.db")) as store:
        with pytest.raises(BadInput) as refused:
            open_study(store, task_of(protocol, tmp_path, apparatus()), text, ObedientClock(), token)
        assert str(refused.value) == str(result.faults[0])
        assert not rows_of(store, schema.subject.select()) + rows_of(store, schema.study.select())


@pytest.mark.parametrize("text", [*BEYOND_BAND.values()], ids=[*BEYOND_BAND])
def test_check_protocol__frequency_beyond_the_band__is_refused(tmp_path, text) -> None:
    (tmp_path / "protocol.toml").write_text(text)
    with pytest.raises(BadInput, match=r"900 Hz on finger 'index'; expected 0\.4 to 300 Hz"):
        check_protocol(tmp_path / "protocol.toml")


@pytest.mark.parametrize(
    ("text", "end"),
    [
        (ruled(UP_DOWN + "floor_db_sl = 8"), "lowest level is 8 dB"),
        (ruled(UP_DOWN + "start_db_sl = 5\nceiling_db_sl = 5"), "highest level is 5 dB"),
        (ruled('kind = "quest-plus"\nhigh_db_sl = 5'), "highest level is 5 dB"),
        (ruled('kind = "curve"\nfloor_db_sl = -5', at=""), "lowest level is -5 dB"),
        (judging(UP_DOWN + "floor_db_sl = 5"), "lowest level is 5 dB"),
    ],
)
def test_check_protocol__levels_end_among_peoples_thresholds__warns(tmp_path, text: str, end: str) -> None:
    (tmp_path / "protocol.toml").write_text(text)
    result = check_protocol(tmp_path / "protocol.toml")
    assert result.holds
    assert [warning.endswith(end) for warning in result.warnings if "expected at" in warning] == [True]


@pytest.mark.parametrize("text", [*USUAL_OR_NOT.values()], ids=[*USUAL_OR_NOT])
def test_check_protocol__unusual_study_that_can_come_to_results__holds(tmp_path, text) -> None:
    (tmp_path / "protocol.toml").write_text(text)
    result = check_protocol(tmp_path / "protocol.toml")
    assert result.holds, [str(fault) for fault in result.faults]


@pytest.mark.parametrize(("repetitions", "criterion", "ends"), [(200, 1.0, False), (10, 1.0, True), (200, 0.95, True)])
def test_recognition__training_to_a_share__ends_where_people_reach_it(repetitions, criterion, ends) -> None:
    text = RECOGNISING.format(repetitions=repetitions, criterion=criterion)
    faults = list(parse_protocol(text, StudyProtocol).faults())
    assert [fault.got.split()[:3] for fault in faults] == ([] if ends else [["block", "1", "of"]])


def test_open_study__required_fact_is_not_given__is_refused(tmp_path) -> None:
    with pytest.raises(BadInput, match="pta is not given"):
        parse_protocol(PROTOCOL + "demographics = { pta = '  ' }\n" + REQUIRED, StudyProtocol)
    text = PROTOCOL + REQUIRED
    (tmp_path / "protocol.toml").write_text(text)
    faults = check_protocol(tmp_path / "protocol.toml").faults
    assert [fault.where for fault in faults] == [("subject S1",), ("subject S2",)]
    with closing(Store(tmp_path / "lab.db")) as store, pytest.raises(BadInput, match="pta is not given"):
        protocol = parse_protocol(text, StudyProtocol)
        open_study(store, task_of(protocol, tmp_path, apparatus()), text, ObedientClock(), token)


@pytest.mark.parametrize(("down", "up"), [(1, 1), (2, 1), (3, 1), (1, 2), (2, 3), (4, 2), (16, 1)])
def test_up_down__point_of_any_rule__is_where_half_of_simulated_steps_go_down(down: int, up: int) -> None:
    """The race is run, answer by answer, from a generator of its own."""
    rng, went_down = np.random.default_rng(3), 0
    point = UpDown(down=down, up=up).point
    for _ in range(4000):
        right = wrong = 0
        while right < down and wrong < up:
            right, wrong = (right + 1, 0) if rng.random() < point else (0, wrong + 1)
        went_down += right == down
    assert went_down / 4000 == pytest.approx(0.5, abs=4.0 * math.sqrt(0.25 / 4000))


@pytest.mark.parametrize(
    "rule", [UpDown(), UpDown(down=1, up=2), UpDown(initial_rule=True), UpDown(down=4, reversals=1, averaged=1)]
)
def test_up_down__fewest_trials__are_those_of_the_shortest_of_all_runs(rule: UpDown) -> None:
    """Answers that always complete a step and turn: no run of the rule's own tracks is shorter, and one is as short."""
    lengths = []
    for first in (True, False):
        track, towards = rule.begin(), first
        while not track.over[0]:
            before = track.level_db_sl[0]
            track.record(towards)
            if track.level_db_sl[0] != before:
                towards = not towards
        lengths.append(int(track.trials[0]))
    assert rule.fewest_trials == min(lengths)


def test_practice__share_that_passes__is_that_of_practice_played_through() -> None:
    text = practised("practice_trials = 6\npractice_correct = 5\npractice_level_db_sl = -40")
    rng, passed = np.random.default_rng(5), []
    for _ in range(2000):
        practice = Practice(0.0, 40, 6, 5)
        while not practice.over:
            practice.record(rng.random() < 1.0 / 3.0)
        passed.append(practice.passed)
    fault = next(iter(parse_protocol(text, StudyProtocol).faults()))
    told = float(fault.got.split("which ")[1].split(" %")[0]) / 100.0
    assert told == pytest.approx(np.mean(passed), abs=4.0 * math.sqrt(0.25 / 1000))


KEPT = ("S1", "7", "012a", "P12", "control", "maya", "mars2x", "A1B2", "Dec", "e5", "1E", "marker1", "june", "x0x1")
CHANGED = {
    "number": ("007", "1E5", "1e400", "12E03", "0x1A", "1.50", "+4", "12345678901234567890"),
    "missing": ("NA", "nan", "None", "n/a"),
    "logical": ("TRUE", "F", "wahr"),
    "date": ("SEP1", "1SEP", "MARCH7", "OCT4", "DEZ24", "1-2", "2-SEP-20", "3/4", "2020-01-02", "12am"),
}


def test_taken_for__codes_that_spreadsheets_change__is_said_and_of_others_nothing() -> None:
    assert {code: taken_for(code) for code in KEPT} == dict.fromkeys(KEPT, "")
    for kind, codes in CHANGED.items():
        assert {code: taken_for(code) for code in codes} == dict.fromkeys(codes, kind)


def test_warnings__codes_of_a_protocol__are_said_with_those_they_are_mixed_with() -> None:
    text = PROTOCOL.replace('"S2"', '"s1"').replace('"hearing-impaired"', '"NA"')
    text += '[[subject]]\ncode = "007"\n[[subject]]\ncode = "7"\nparticipant_id = "1-2"\n'
    warnings = list(parse_protocol(text, StudyProtocol).warnings())
    assert warnings == [
        "S1 is mixed with s1 by other programs", "s1 is mixed with S1 by other programs",
        "007 is the number 7 to spreadsheets", "007 is mixed with 7 by other programs",
        "7 is mixed with 007 by other programs", "1-2 is a date or a time to spreadsheets",
        "NA is a missing value to other programs",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["subject", "enrolled_utc", "participant_id", "visit"])
def test_fact__named_as_a_column_of_the_exports__is_refused_by_key(name: str) -> None:
    """It took the place of the subject's code, or of another column, in every export."""
    with pytest.raises(BadInput, match=f"name is '{name}'; it must be another name"):
        parse_protocol(PROTOCOL + REQUIRED.replace("pta", name), StudyProtocol)


def test_facts__of_one_name__are_refused() -> None:
    with pytest.raises(BadInput, match="demographic names pta, pta"):
        parse_protocol(PROTOCOL + REQUIRED + REQUIRED, StudyProtocol)
