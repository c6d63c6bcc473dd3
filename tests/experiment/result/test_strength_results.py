"""Contours of a store: two simulated people at the display, a finger against another, and the file of it."""

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.protocol.file import parse_any_protocol
from tactuator.experiment.result.strength_results import contour_results
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.simulated.sitting import run_study
from tactuator.experiment.simulated.strength_people import people_of
from tactuator.experiment.store.store import Store
from tactuator.io.csv_tables import read_contours, write_contours
from tactuator.perception.curve import ThresholdCurve, curve
from tactuator.table import ResultTable
from tactuator.verbs.strength import StoreContours, judged
from tests.experiment.session.apparatuses import apparatus
from tests.experiment.session.test_judging_task import ESTIMATION, HEAD

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


def observed(path, text: str) -> None:
    protocol, store = parse_any_protocol(text), Store(path)
    codes = [subject.code for subject in protocol.subject]
    people = people_of(codes, dict.fromkeys(codes, "sensation-level"), {}, curve("bolanowski-1988"), 3)
    run_study(store, protocol, text, apparatus(), people, SystemClock())
    store.close()


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
    assert again.provenance == "simulated"
    assert np.sqrt(np.mean((again.db_sl - again.level_db_sl[:, None]) ** 2)) < 4.0
    assert all("equal-velocity" in person.estimate.laws for person in results.people)  # the curve is known
    mine = contour_results(tmp_path / "lab.db", curve=MINE)
    assert mine.people[0].contours.source.endswith("dB SL of mine")
    # a person who is 6 dB less sensitive at 100 Hz, and below 6 dB more: what is as strong as 30 dB SL has moved so
    at_hz = np.array([30.0, 150.0])
    moved = mine.people[0].contours.level_db_sl_at(30.0, at_hz) - results.people[0].contours.level_db_sl_at(36.0, at_hz)
    assert moved == pytest.approx(-MORE_DB * np.log2(at_hz / 100.0) - 6.0, abs=3.0)


def test_contour_results__another_finger_at_the_same_frequency__gives_its_balance_and_no_figure(tmp_path) -> None:
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
    with pytest.raises(BadInput, match="no done run of matching"):
        contour_results(tmp_path / "empty.db")
    with pytest.raises(BadInput, match="the store holds no study; allowed: a study in which tones are judged"):
        judged(tmp_path / "empty.db")
