"""Tables of results and language files: each word stands in them, the same keys everywhere; and contours of a store."""

import re
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from tactuator.api.strength import StoreContours, judged
from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import StudyProtocol, parse_protocol
from tactuator.experiment.result.confusion import (
    AbxResult,
    SubjectResult,
    abx_table,
    information_table,
    matrix_table,
    threshold_table,
)
from tactuator.experiment.result.information import ESTIMATORS, POSTERIOR, information
from tactuator.experiment.result.strength_results import contour_results
from tactuator.experiment.result.thresholds import DOUBTFUL, MeasuredThreshold
from tactuator.experiment.session.respondent import run_session
from tactuator.experiment.session.studies import open_session, open_study, task_of
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.store.records import Visit
from tactuator.experiment.store.store import Store
from tactuator.experiment.words import Words, difference, read_words, shipped_languages, shipped_words
from tactuator.io.csv_tables import read_contours, write_contours
from tactuator.perception.curve import ThresholdCurve, curve
from tactuator.result import ResultTable
from tests.experiment.session.apparatuses import apparatus
from tests.experiment.session.test_judging_task import ESTIMATION, HEAD, Level

MARKED = Words("qps", {key: f"⟦{text}⟧" for key, text in shipped_words("en").texts.items()})

ONE = MeasuredThreshold(
    subject="7", group="unknown", finger="8", frequency_hz=100.0, procedure="quest-plus", run=1, trials=48, point=0.794,
    own_db_sl=1.0, own_standard_error_db=1.0, reversal_spread_db=None, refit_db_sl=1.1, refit_sd_db=1.0,
    refit_low_db_sl=-1.0, refit_high_db_sl=3.0, bound="", delivered_db=0.0, delivered_sd_db=0.1,
    own_level_db_re_1um=1.0, level_db_re_1um=1.1, level_low_db_re_1um=-1.0, level_high_db_re_1um=3.0, sd_db=1.0,
    curve="bolanowski-1988",
    flags=tuple(sorted(DOUBTFUL)), lapse_power=0.2, drift_power=0.2, simulated=True,
)  # fmt: skip


def words_left(table: ResultTable) -> list[str]:
    texts = [table.caption, *table.columns, *(cell for row in table.rows for cell in row), *table.notes]
    left = []
    for text in texts:
        for _ in range(3):  # a text may hold another
            text = re.sub(r"⟦[^⟦⟧]*⟧", "", text)
        left.append(text)
    return [text for text in left if re.search("[A-Za-z]{2}", text)]


@pytest.mark.parametrize(
    "counts", [np.eye(12) * 20, np.eye(60) * 5, np.array([[5, 1, 2], [0, 6, 2]]), np.diag([9.0, 8.0, 0.0])]
)
def test_tables__information_in_a_language_of_ones_own__has_no_other_word(counts) -> None:
    found = information(counts, np.random.default_rng(0), seconds_per_stimulus=0.5)
    assert words_left(information_table(MARKED("results.information"), found, MARKED)) == []


def test_tables__of_thresholds__have_no_other_word_and_tell_of_a_notch() -> None:
    table = threshold_table([ONE, replace(ONE, bound=">=")], MARKED)
    assert len(table.notes) == 4
    assert words_left(table) == []
    one = replace(ONE, refit_db_sl=1.26, refit_low_db_sl=-1.4, refit_high_db_sl=3.9, level_db_re_1um=-7.44)
    (row,) = threshold_table([one], MARKED).rows
    assert (row[5], row[7]) == ("1.3", "-7.4")
    for low, high, told in (
        (-1.0, np.inf, "≥ -1.0"), (-np.inf, 3.0, "≤ 3.0"), (-1.0, 3.0, "-1.0 to 3.0"), (-np.inf, np.inf, "–"),
    ):  # fmt: skip
        (row,) = threshold_table([replace(ONE, refit_low_db_sl=low, refit_high_db_sl=high)], shipped_words("en")).rows
        assert row[6] == told
    points = [replace(ONE, procedure="curve", frequency_hz=hertz, notch_trials=count) for hertz, count in
              ((10.0, 0), (192.0, 3), (250.0, 4))]  # fmt: skip
    notes = threshold_table(points, shipped_words("en")).notes
    (told,) = [note for note in notes if "notch" in note]
    assert told == (
        "7: a notch of 15 dB is not excluded at 192 Hz (3 more trials would exclude it), "
        "250 Hz (4 more trials would exclude it)"
    )
    assert not words_left(threshold_table(points, MARKED))
    assert not any("notch" in note for note in threshold_table([ONE], shipped_words("en")).notes)


def test_tables__recognition__have_no_other_word_and_say_what_nobody_felt() -> None:
    words, counts = shipped_words("en"), np.array([[9, 1], [2, 8]])
    of_people = SubjectResult(
        "9", "recognition", "7", ("1", "2"), counts, 1.0, information(counts, np.random.default_rng(0))
    )
    abx = AbxResult("9", "7", 10, 0.9)
    assert words_left(matrix_table(of_people, MARKED)) == words_left(abx_table(abx, MARKED)) == []
    for simulated in (False, True):
        matrix = replace(of_people, simulated=simulated)
        tables = (
            matrix_table(matrix, words),
            information_table("9", matrix.information, words, matrix.simulated),
            abx_table(replace(abx, simulated=simulated), words),
        )
        assert ["simulated: nobody felt this" in table.notes for table in tables] == [simulated] * 3


@pytest.mark.parametrize("language", shipped_languages())
def test_languages__every_flag_and_estimator__has_a_text(language: str) -> None:
    texts = shipped_words(language).texts
    flags = {"cue", "floor", "ceiling", "trial-limit", "out-of-range", "saturated", "delivered-unknown", *DOUBTFUL}
    assert {f"results.flag_{name.replace('-', '_')}" for name in flags} <= set(texts)
    assert {f"results.estimator_{name}" for name in (*ESTIMATORS, POSTERIOR)} <= set(texts)


TASK = '[task]\nkind = "matching"\nfinger = "index"\nband_hz = [20, 150]\ntrials = 40\n'
PAIRS = (
    '[task]\nkind = "matching"\nfinger = "index"\nmethod = "pairs"\ncomparison_fingers = ["thumb"]\n'
    "comparisons_hz = [100]\nlevels_db_sl = [20, 30]\nreversals = 4\n"
)
MORE_DB = 4.0
THEIRS = curve("bolanowski-1988")
HERTZ = np.geomspace(15.0, 200.0, 12)
MINE = ThresholdCurve(
    "mine", HERTZ, THEIRS.level_db_re_1um_at(HERTZ) + 6.0 + MORE_DB * np.log2(HERTZ / 100.0), "measured", "me"
)


class Noisy(Level):
    """Judges by the commanded level, with a scatter of 1.7 dB."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.rng = np.random.default_rng(seed)

    def felt_db(self, tone) -> float:
        return super().felt_db(tone) + 1.7 * float(self.rng.standard_normal())


def observed(path, text: str) -> None:
    protocol = parse_protocol(text, StudyProtocol)
    with closing(Store(path)) as store:
        task = task_of(protocol, path.parent, apparatus())
        study = open_study(store, task, text, SystemClock(), lambda code, visit: f"{code}-{visit}")
        for number, subject in enumerate(protocol.subject):
            session = open_session(study, subject.code, Visit("simulated"))
            run_session(session, Noisy(number))


def test_contour_results__two_people__give_contours_that_a_file_gives_back(tmp_path) -> None:
    observed(tmp_path / "lab.db", HEAD + '[[subject]]\ncode = "S2"\n' + TASK)
    results = contour_results(tmp_path / "lab.db")
    assert [person.subject for person in results.people] == ["S1", "S2"]
    assert results.simulated
    assert results.group is not None
    told = StoreContours(results)
    assert told.chart().simulated
    assert set(told.columns()["simulated"]) == {"simulated"}
    tables = [table for table in told.tables() if isinstance(table, ResultTable)]
    assert tables
    assert all("simulated: nobody felt this" in table.notes for table in tables)
    write_contours(tmp_path / "contours.csv", results.group)
    again = read_contours(tmp_path / "contours.csv")
    assert again == results.group
    assert {again.provenance, results.people[0].contours.provenance} == {"simulated"}
    assert again.contact.said == {}
    assert np.sqrt(np.mean((again.db_sl - again.level_db_sl[:, None]) ** 2)) < 4.0
    assert all("equal-velocity" in person.estimate.evidence for person in results.people)  # the curve is known
    mine = contour_results(tmp_path / "lab.db", curve=MINE)
    assert mine.people[0].contours.source.endswith("dB SL of mine")
    # a person who is 6 dB less sensitive at 100 Hz, and below 6 dB more: what is as strong as 30 dB SL has moved so
    at_hz = np.array([30.0, 150.0])
    moved = mine.people[0].contours.level_db_sl_at(30.0, at_hz) - results.people[0].contours.level_db_sl_at(36.0, at_hz)
    assert moved == pytest.approx(-MORE_DB * np.log2(at_hz / 100.0) - 6.0, abs=3.0)


def test_contour_results__another_finger_at_the_same_frequency__gives_its_balance(tmp_path) -> None:
    observed(tmp_path / "line.db", HEAD + PAIRS.replace('comparison_fingers = ["thumb"]', "").replace("[100]", "[40]"))
    with pytest.raises(BadInput, match="three frequencies, on both sides of 100 Hz"):
        contour_results(tmp_path / "line.db", curve=MINE)
    observed(tmp_path / "lab.db", HEAD + PAIRS)
    assert judged(tmp_path / "lab.db").to_dict()["tables"]
    with pytest.raises(BadInput, match="nothing to draw"):
        judged(tmp_path / "lab.db", figures=tmp_path / "figures")
    results = contour_results(tmp_path / "lab.db")
    assert results.group is None
    (balance,) = results.balance
    assert balance.finger == "thumb"
    assert balance.offset_db.value == pytest.approx(0.0, abs=2.0)


def test_judged__magnitudes_at_the_display__are_told_and_drawn(tmp_path) -> None:
    observed(tmp_path / "lab.db", HEAD + ESTIMATION.replace("repeats = 1", "repeats = 2"))
    result = judged(tmp_path / "lab.db", figures=tmp_path / "figures")
    assert result.headline() == {"task": "magnitude-estimation", "runs": "1", "simulated": "nobody felt this"}
    assert [row[0] for row in result.to_dict()["tables"][0]["rows"]] == ["40", "250"]
    assert (tmp_path / "figures" / "magnitude-estimation.svg").exists()
    with pytest.raises(BadInput, match="no done run of matching"):
        judged(tmp_path / "lab.db", task="matching")
    Store(tmp_path / "empty.db").close()
    with pytest.raises(BadInput, match="has no task of matches"):
        contour_results(tmp_path / "empty.db")
    with pytest.raises(BadInput, match="the store holds no study; expected a study in which tones are judged"):
        judged(tmp_path / "empty.db")


ENGLISH = shipped_words("en").texts


def test_languages__shipped__are_english_and_two_more_with_the_same_keys_and_names() -> None:
    assert set(shipped_languages()) >= {"en", "de", "fr"}
    for language in shipped_languages():
        texts = shipped_words(language).texts
        assert difference(texts, ENGLISH) is None, language
        same = {key for key, text in texts.items() if text == ENGLISH[key] and len(text) > 12}
        assert language == "en" or same <= {"operator.minutes", "operator.rig", "run.title"}
    with pytest.raises(BadInput, match="language 'tlh'; expected de, en, fr, he, or a language_file"):
        shipped_words("tlh")


def written(tmp_path, change):
    tables: dict[str, list[str]] = {}
    for key, text in change(dict(ENGLISH)).items():
        table, _, name = key.partition(".")
        quoted = text.replace('"', '\\"')
        tables.setdefault(table, []).append(f'{name} = "{quoted}"')
    (tmp_path / "xx.toml").write_text("".join(f"[{name}]\n" + "\n".join(each) + "\n" for name, each in tables.items()))
    return tmp_path / "xx.toml"


def test_language_file__of_ones_own__is_read(tmp_path) -> None:
    words = read_words(written(tmp_path, lambda texts: texts | {"page.done": "Finis."}), "la")
    assert (words("page.done"), words("page.wrong", right="2"), words.language) == ("Finis.", "No, it was 2", "la")
    (tmp_path / "bytes.toml").write_bytes(b"\xff")
    (tmp_path / "broken.toml").write_bytes(b"[page\n")
    for name in ("missing.toml", "bytes.toml", "broken.toml"):
        with pytest.raises(BadInput, match=r"language file .*TOML as the shipped files are"):
            read_words(tmp_path / name, "la")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda texts: {k: v for k, v in texts.items() if k != "page.done"}, "keys missing: page.done; beyond: none"),
        (lambda texts: texts | {"page.more": "x"}, "keys missing: none; beyond: page.more"),
        (lambda texts: texts | {"page.wrong": "No."}, "page.wrong puts in nothing; expected right"),
        (lambda texts: texts | {"page.wrong": "No, {right"}, "page.wrong puts in a brace"),
        (lambda texts: texts | {"page.done": ""}, "page.done has 0 characters"),
        (lambda texts: texts | {"page.done": "x" * 401}, "page.done has 401 characters"),
    ],
)
def test_language_file__that_is_not_whole__is_refused_in_one_line(tmp_path, change, words) -> None:
    with pytest.raises(BadInput, match=words) as told:
        read_words(written(tmp_path, change), "la")
    assert "\n" not in str(told.value)
