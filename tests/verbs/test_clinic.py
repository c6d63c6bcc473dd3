"""The sheet of a visit: what stands on it, in each language, with and without a norm."""

import re

import pytest

from tactuator.errors import BadInput
from tactuator.experiment.store.store import Store
from tactuator.experiment.words import shipped_words
from tactuator.verbs.store import sheet
from tests.experiment.session import apparatuses
from tests.experiment.session.apparatuses import PROTOCOL, ObedientClock, begin, everything

NORM = "# source: a made-up table, of no people\nfinger,age_low,age_high,frequency_hz,mean_db_re_1um,sd_db\n"
AGE = '\n[[demographic]]\nname = "age"\nlabel = "Age"\nkind = "number"\n'
STANDARD = "\n[standard]\nramp_low_s = 0.5\n"
TEXT = PROTOCOL.replace('code = "S1"', 'code = "S1"\ndemographics = { age = 52 }') + AGE + STANDARD


def answered(tmp_path, text):
    store, clock = Store(tmp_path / "lab.db"), ObedientClock()
    everything(begin(store, clock, text), clock)
    store.close()
    return tmp_path / "lab.db"


def rows(path):
    return [re.findall(r"<td>(.*?)</td>", row) for row in re.findall(r"<tr>(<td>.*?)</tr>", path.read_text())]


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return answered(tmp_path_factory.mktemp("sheet"), TEXT)


def test_sheet__with_a_norm__has_z_of_its_own_level_and_every_unmet_condition(store, tmp_path) -> None:
    (tmp_path / "norm.csv").write_text(NORM + "index,50,59,30,0.0,2.0\nany,20,49,90,0,2\n")
    result = sheet("S1", store, tmp_path / "sheet.html", norm=tmp_path / "norm.csv")
    assert list(result.tables()) == list(result.unmet)  # the command tells by itself what it wrote
    page, table = (tmp_path / "sheet.html").read_text(), rows(tmp_path / "sheet.html")
    assert result.thresholds == len(table) == 3
    scored = next(row for row in table if row[1] == "30")
    level = float(scored[2].lstrip("≥≤ "))
    assert float(scored[4].lstrip("≥≤ ")) == pytest.approx(level / 2.0, abs=0.06)
    assert [z is None for z in result.z].count(False) == 1
    assert "a made-up table, of no people" in page
    assert "ramp: 0.01 s (allowed: at least 0.5 s)" in page
    assert "the ramp at 210 Hz: 0.01 s (allowed: at least 0.5 s)" in page
    assert "S1 (hearing)" in page
    assert "<dd>52</dd>" in page
    assert "<dt>Site</dt><dd>–</dd><dt>Contact</dt><dd>78.5 mm²</dd>" in page  # what nobody stated is no fact
    with pytest.raises(BadInput, match="visit 2 of subject 'S1'"):
        sheet("S1", store, tmp_path / "none.html", visit=2)
    for age in (-1.0, 300.0, float("nan")):
        with pytest.raises(BadInput, match=rf"age of {age:g} years; allowed: 0 to 130"):
            sheet("S1", store, tmp_path / "none.html", age=age)
    assert not (tmp_path / "none.html").exists()


def test_sheet__of_who_feels_nothing__has_intervals_that_are_open_above(tmp_path, monkeypatch) -> None:
    def wrong(trial):
        return next(each for each in trial.responses if each != trial.correct)

    monkeypatch.setattr(apparatuses, "response_of", wrong)
    text = TEXT.replace("reversals = 6", "reversals = 6\ntrial_limit = 12").replace("consent =", "# consent =")
    result = sheet("S1", answered(tmp_path, text), tmp_path / "sheet.html")
    assert all(row[2].startswith("≥ ") and row[3].endswith("… ∞") for row in rows(tmp_path / "sheet.html"))
    assert result.z == (None, None, None)
    assert "<dd>1: 2026-03-01 12:" in (tmp_path / "sheet.html").read_text()  # when it was, without a consent too
    assert "there are no z-scores" in (tmp_path / "sheet.html").read_text()


def test_sheet__in_another_language__says_all_its_words(tmp_path) -> None:
    sheet(
        "S1", answered(tmp_path, TEXT.replace("[study]", '[study]\nlanguage = "fr"')), tmp_path / "sheet.html", age=30.0
    )
    page, texts = (tmp_path / "sheet.html").read_text(), shipped_words("fr").texts
    words = {key: text.replace("'", "&#x27;") for key, text in texts.items() if key.startswith("sheet.")}
    assert {key for key, text in words.items() if text not in page} <= {"sheet.norm_source", "sheet.none"}
    assert 'lang="fr"' in page
