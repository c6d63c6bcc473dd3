"""From a study through the simulated display to thresholds, a curve, exports: simulate, estimate, recover."""

import csv
import json

import numpy as np
import pytest

from tactuator.errors import BadInput
from tactuator.experiment.export import export
from tactuator.experiment.procedure.refit import refit
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.result.store_results import circumstances, group_curve, psychometric_trials
from tactuator.experiment.result.thresholds import thresholds
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.simulated.sitting import run_study, simulated_observers, with_truths
from tactuator.experiment.store.store import Store
from tactuator.experiment.store.stored_runs import detection_runs
from tactuator.io.csv_tables import read_curve, write_curve
from tactuator.perception.curve import RelativeCurve, curve
from tactuator.report.felt import psychometric_plate
from tests.experiment.session.apparatuses import PROTOCOL, apparatus

TEXT = (
    PROTOCOL[: PROTOCOL.index("[procedure]")]
    + '[procedure]\nkind = "up-down"\nreversals = 9\naveraged = 6\n'
    + '[conditions]\nfingers = ["index"]\nfrequencies_hz = [8, 40, 200]\n'
    + PROTOCOL[PROTOCOL.index("[circumstances]") :].replace("stimulus_s = 0.05", "stimulus_s = 0.25")
)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    store = Store(tmp_path_factory.mktemp("study") / "lab.db")
    observers = simulated_observers(curve("bolanowski-1988"), 2, seed=5)
    run_study(store, parse_protocol(TEXT), TEXT, apparatus(), observers, SystemClock(), "finger")
    yield store, dict(zip(("S1", "S2"), observers, strict=True))
    store.close()


def test_thresholds__through_the_display__are_the_observers_own(study) -> None:
    store, observers = study
    found = thresholds(detection_runs(store))
    assert len(found) == 6
    for one in found:
        truth = float(observers[one.subject].curve.level_db_re_1um_at(one.frequency_hz))
        assert one.level_db_re_1um == pytest.approx(truth, abs=3.5 * one.refit_sd_db + 0.5)
        assert 25 <= one.trials <= 100
        assert one.refit_low_db_sl < one.refit_db_sl < one.refit_high_db_sl
        assert one.own_db_sl == pytest.approx(one.refit_db_sl, abs=3.0)


@pytest.mark.slow
def test_delivered__298_hz_near_minus_4_db_sl__is_known_to_a_fifth_of_a_decibel(store) -> None:
    """The sensor's hum exceeds the stimulus there; the loud trials show the gain."""
    people = "".join(f'[[subject]]\ncode = "D{number}"\n' for number in range(6))
    text = (
        '[study]\nname = "delivered"\nseed = 4\n[procedure]\nkind = "quest-plus"\ntrials = 48\n'
        f'[conditions]\nfingers = ["index"]\nfrequencies_hz = [298]\n[catch]\nloud_share = 0.2\n{people}'
    )
    codes = [f"D{number}" for number in range(6)]
    zero = curve("bolanowski-1988")
    low = RelativeCurve(np.array([100.0]), np.array([-4.0]), "4 dB below")
    observers = with_truths(simulated_observers(zero, 6, seed=1), codes, zero, dict.fromkeys(codes, low), {})
    run_study(store, parse_protocol(text), text, apparatus(), observers, SystemClock(), "finger")
    found = thresholds(detection_runs(store))
    delivered = np.array([one.delivered_db for one in found])
    assert len(found) == 6
    assert max(one.delivered_sd_db for one in found) <= 0.2
    assert delivered.std(ddof=1) <= 0.3  # six runs of a standard deviation of 0.15 to 0.2
    assert np.ptp(delivered) > 0.0
    for one in found:
        assert one.sd_db == pytest.approx(float(np.hypot(one.refit_sd_db, one.delivered_sd_db)))
        assert one.level_low_db_re_1um <= float(zero.level_db_re_1um_at(298.0)) - 4.0 <= one.level_high_db_re_1um


def test_whole_curve__through_the_display__follows_the_truth(store) -> None:
    head = PROTOCOL[: PROTOCOL.index("[procedure]")] + '[procedure]\nkind = "curve"\ntrials = 60\n'
    rest = PROTOCOL[PROTOCOL.index("[timing]") : PROTOCOL.rindex("[[subject]]")]
    text = head + '[conditions]\nfingers = ["index"]\n' + rest
    observers = simulated_observers(curve("bolanowski-1988"), 1, seed=2)
    run_study(store, parse_protocol(text), text, apparatus(), observers, SystemClock(), "finger")
    runs = detection_runs(store)
    found = thresholds(runs)
    (drawn,) = psychometric_trials(runs, found)["S1"]
    assert drawn.whole_curve
    assert drawn.count.sum() == 60
    assert drawn.threshold.refit_db_sl == pytest.approx(0.0, abs=2.5)  # curve and function tell the same story
    plate = psychometric_plate("S1", [drawn])
    assert "relative to the run's own curve" in plate.caption
    assert plate.figure.axes[0].get_title().startswith("index, whole curve")
    truth = observers[0].curve.level_db_re_1um_at([one.frequency_hz for one in found])
    errors = np.array([one.level_db_re_1um for one in found]) - truth
    assert float(np.sqrt(np.mean(errors**2))) < 3.5
    assert found[0].trials == 60
    assert len(found) == 28  # every frequency at which trials may be put
    assert all(one.notch_trials is not None and one.notch_trials >= 0 for one in found)
    assert any(one.notch_trials for one in found)  # sixty trials cannot exclude a notch everywhere


def test_group_curve__written__is_read_back_with_what_it_was_measured_under(study, tmp_path) -> None:
    store, _ = study
    runs = detection_runs(store)
    group = group_curve(thresholds(runs), curve("bolanowski-1988"), (0.4, 300.0))
    assert group.subjects == (0, 2, 2, 2, 0)
    assert group.curve.covers(0.4, 300.0)
    write_curve(tmp_path / "curve.csv", group.curve, circumstances(group, runs))
    back = read_curve(tmp_path / "curve.csv")
    assert back.provenance == back.name == "simulated"
    assert "nobody felt it" in back.source
    assert back.level_db_re_1um == pytest.approx(group.curve.level_db_re_1um, abs=1e-3)
    lines = [line for line in (tmp_path / "curve.csv").read_text().splitlines() if not line.startswith("#")]
    row = next(csv.DictReader(lines))
    assert row["contact_area_mm2"] == "78.5"
    assert row["subject_group"] == "hearing;hearing-impaired"
    assert (row["finger"], row["experimenter"], row["masking_sound"], row["preload_n"]) == ("index", "EX", "pink", "")


def test_group_curve__two_frequencies__is_refused(study) -> None:
    store, _ = study
    found = [one for one in thresholds(detection_runs(store)) if one.frequency_hz < 100.0]
    with pytest.raises(BadInput, match="2 measured frequencies"):
        group_curve(found, curve("bolanowski-1988"), (0.4, 300.0))


@pytest.mark.parametrize("form", ["tidy", "psych-ds", "bids"])
def test_export__any_format__carries_every_trial_and_a_word_for_every_column(study, tmp_path, form) -> None:
    store, _ = study
    count = export(store, tmp_path / "out", form)
    tables = [path for path in (tmp_path / "out").rglob("*") if path.stem.endswith(("trials", "trials_data", "_beh"))]
    rows, columns = 0, set()
    for path in tables:
        if path.suffix in (".csv", ".tsv"):
            with path.open() as stream:
                reader = csv.DictReader(stream, delimiter="\t" if path.suffix == ".tsv" else ",")
                rows += len(list(reader))
                columns |= set(reader.fieldnames or ())
    assert rows == count > 200
    assert columns <= _described(tmp_path / "out", form)


def _described(folder, form) -> set[str]:
    if form == "tidy":
        with (folder / "dictionary.csv").open() as stream:
            return {row["column"] for row in csv.DictReader(stream) if row["table"] == "trials"}
    if form == "psych-ds":
        document = json.loads((folder / "dataset_description.json").read_text())
        return {one["name"] for one in document["variableMeasured"]}
    sidecar = json.loads(next(folder.rglob("*_beh.json")).read_text())
    assert (folder / "participants.tsv").read_text().startswith("participant_id\tsubject_group\tenrolled_utc\n")
    return set(sidecar) - {"TaskName", "TaskDescription"}


def test_export__format_unknown_or_store_empty__is_refused(study, store, tmp_path) -> None:
    with pytest.raises(BadInput, match="tidy, psych-ds, bids"):
        export(study[0], tmp_path / "out", "spss")
    with pytest.raises(BadInput, match="no response"):
        export(store, tmp_path / "out", "tidy")
    with pytest.raises(BadInput, match="no done run"):
        detection_runs(store)
    assert not (tmp_path / "out").exists()


def test_refit__few_trials__is_refused() -> None:
    with pytest.raises(BadInput, match="4 trials"):
        refit(np.zeros(4), np.ones(4, dtype=bool))
