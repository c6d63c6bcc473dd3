"""What a clinic may trust: who is left out of a group curve, what is clipped, what is called simulated."""

import csv
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.lines import CARETUPBASE

from tactuator.errors import BadInput
from tactuator.experiment.procedure.procedure import Playable
from tactuator.experiment.procedure.refit import refit
from tactuator.experiment.procedure.whole_curve import WholeCurve
from tactuator.experiment.protocol.file import Protocol, parse_protocol
from tactuator.experiment.result.confusion import threshold_table
from tactuator.experiment.result.played import delivered_levels
from tactuator.experiment.result.store_results import (
    circumstances,
    group_curve,
    person_thresholds,
    psychometric_trials,
    store_results,
)
from tactuator.experiment.result.thresholds import DOUBTFUL, played_at, thresholds
from tactuator.experiment.session.task import SystemClock
from tactuator.experiment.simulated.subjects import run_study, simulated_observers, with_truths
from tactuator.experiment.store.store import opened_store
from tactuator.experiment.store.stored_runs import StoredRun, detection_runs
from tactuator.experiment.words import shipped_words
from tactuator.io.csv_tables import read_curve, write_curve
from tactuator.io.display import parse_display, with_curve
from tactuator.model.description import display_document
from tactuator.perception import curve as library
from tactuator.perception.curve import RelativeCurve
from tactuator.plain import finite
from tactuator.report.felt_figures import psychometric_figure, thresholds_figure
from tactuator.report.figure import save_figures
from tests.experiment.session.apparatuses import PROTOCOL, apparatus, controller

LIBRARY = library.curve("bolanowski-1988")
DEAF = RelativeCurve(np.array([10.0]), np.array([90.0]), "feels nothing")
TEXT = (
    PROTOCOL.replace("steps_db = [4, 2]\nreversals = 6\naveraged = 4", "reversals = 9\naveraged = 6\ntrial_limit = 60")
    .replace("[30, 90, 210]", "[8, 30, 200]")
    .replace("[circumstances]", "[catch]\nloud_share = 0.2\nblank_share = 0.1\n[circumstances]")
    .replace("stimulus_s = 0.05\nramp_s = 0.01", "stimulus_s = 0.25\nramp_s = 0.05")
    .replace("practice_trials = 2", "practice_trials = 0")
)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    drawn = simulated_observers(LIBRARY, 2, seed=5)
    observers = with_truths(drawn, ("S1", "S2"), LIBRARY, {"S2": DEAF}, {"S1": 0.0})
    with opened_store(tmp_path_factory.mktemp("trust") / "lab.db") as store:
        run_study(store, parse_protocol(TEXT, Protocol), TEXT, apparatus(), observers, SystemClock(), "finger")
        yield store, observers


def test_thresholds__of_one_who_feels_nothing__are_censored_in_the_curve(study):
    store, observers = study
    found = thresholds(detection_runs(store))
    for one in found:
        if one.subject == "S1":
            truth = float(observers[0].curve.level_db_re_1um_at(one.frequency_hz))
            assert one.level_db_re_1um == pytest.approx(truth, abs=4.0 * one.sd_db + 0.5)
            assert not {"chance", "out-of-range", "mains", "attention"} & set(one.flags)
            assert one.level_low_db_re_1um < one.level_db_re_1um < one.level_high_db_re_1um
            assert one.point == pytest.approx(0.5 ** (1 / 3), abs=1e-4)
    deaf = [one for one in found if one.subject == "S2"]
    assert len(deaf) == 3
    for one in deaf:
        assert {"chance", "out-of-range"} <= set(one.flags)
        assert one.bound == ">="
        assert one.refit_high_db_sl == one.level_high_db_re_1um == np.inf
        assert np.isnan(one.refit_sd_db)
    group = group_curve(found, LIBRARY, (0.4, 300.0))
    assert group.subjects == (0, 2, 2, 2, 0)
    assert group.censored == (0, 1, 1, 1, 0)
    assert group.bound == (">=",) * 5  # one person measured and one beyond: the mean is known from one side
    alone = group_curve([one for one in found if one.subject == "S1"], LIBRARY, (0.4, 300.0))
    assert np.all(group.curve.level_db_re_1um > alone.curve.level_db_re_1um + 5.0)
    assert set(circumstances(group, detection_runs(store))["bound"]) == {">="}
    for leave_out in (["flagged"], ["S2"]):  # the experimenter alone leaves somebody out
        group = group_curve(found, LIBRARY, (0.4, 300.0), leave_out)
        assert group.curve.level_db_re_1um == pytest.approx(alone.curve.level_db_re_1um)
        assert {one.subject for one in group.left_out} == {"S2"}
        assert group.subjects == (0, 1, 1, 1, 0)
        with pytest.raises(BadInput, match="3 thresholds left out"):
            group_curve(deaf, LIBRARY, (0.4, 300.0), leave_out)
    with pytest.raises(BadInput, match="S9; expected flagged, S1, S2"):
        group_curve(found, LIBRARY, (0.4, 300.0), ["S9"])
    for leave_out, subjects, which in (([], [2, 1], "without"), (["flagged"], [1, 2], "with")):
        told = store_results(store.path, leave_out=leave_out)
        document = json.loads(json.dumps(finite(told.document()), allow_nan=False))
        assert [max(point["subjects"] for point in document[name]) for name in ("curve", "curve_beside")] == subjects
        assert told.beside_is == f"{which} those flagged"
        assert {each["subject"] for each in document["doubtful"]} >= {"S2"}
        ends = {(each["bound"], each["refit_high_db_sl"]) for each in document["thresholds"] if each["subject"] == "S2"}
        assert ends == {(">=", None)}


def test_figure__of_a_subject_of_a_study_of_any_name__is_a_file_in_the_folder(study, tmp_path) -> None:
    store, _ = study
    ((_, drawn), *_) = psychometric_trials(detection_runs(store), thresholds(detection_runs(store)))
    names = ("S1-left/right\n", "S1-" + 200 * "\u6307")
    save_figures([psychometric_figure(name, drawn[:1]) for name in names], tmp_path)
    assert len([*tmp_path.glob("psychometric-S1-*.svg")]) == 2


def test_thresholds__simulated_doubtful_or_censored__are_marked_in_every_figure(study):
    store, _ = study
    found = thresholds(detection_runs(store))
    assert all(one.simulated for one in found)
    for stranger, lapse, words in (({"S9": DEAF}, {}, "S9"), ({}, {"S1": 0.5}, "lapse")):
        with pytest.raises(BadInput, match=words):
            with_truths(simulated_observers(LIBRARY, 1, seed=5), ("S1",), LIBRARY, stranger, lapse)
    notes = threshold_table(found, shipped_words("en")).notes
    assert any("simulated" in note for note in notes)
    assert any("79.4 % correct" in note for note in notes)
    assert group_curve(found, LIBRARY, (0.4, 300.0)).curve.provenance == "simulated"
    figures = dict(psychometric_trials(detection_runs(store), found))
    figure = psychometric_figure("S1", figures["S1"])
    assert "simulated" in figure.caption
    assert [text.get_text() for text in figure.drawing.legends[0].texts][::3] == ["fit", "procedure's own"]
    assert set(figure.table["simulated"]) == {"simulated"}
    for drawn in (figure, thresholds_figure(person_thresholds(found), LIBRARY, None)):
        assert "simulated: nobody felt this" in drawn.svg()
        assert drawn.drawing.get_suptitle() == "simulated: nobody felt this"
        assert ",simulated\n" in drawn.csv()
    felt = thresholds_figure(person_thresholds([replace(one, simulated=False) for one in found]), LIBRARY, None)
    assert "simulated" not in felt.svg() + felt.csv()
    assert sum(figure.table["trials"]) == sum(int(one.count.sum()) for one in figures["S1"])
    people = person_thresholds(found)
    figure = thresholds_figure(people, LIBRARY, None)
    doubtful, beyond = sum(bool(DOUBTFUL & set(one.flags)) for one in found), sum(bool(one.bound) for one in found)
    assert f"Crossed: {doubtful} thresholds" in figure.caption
    assert f"Arrows: {beyond} that lie beyond" in figure.caption
    axes = figure.drawing.axes[0]
    arrows, crosses = (
        np.concatenate([line.get_xydata() for line in axes.lines if line.get_marker() == marker])
        for marker in (CARETUPBASE, "x")
    )
    assert sum(bool(bound) for bound in figure.table["bound"]) == beyond == len(arrows) == 3
    assert np.all(arrows[:, 1] < axes.get_ylim()[1])
    assert sum(figure.table["flagged"]) == len(crosses) == doubtful
    assert "flagged" not in thresholds_figure([replace(one, flagged=None) for one in people], LIBRARY, None).table


def test_group_curve__of_two_studies__counts_people_and_is_read_back(study, tmp_path):
    found = sorted(thresholds(detection_runs(study[0])), key=lambda one: one.frequency_hz)
    felt = [replace(one, simulated=False) for one in found if one.subject == "S1"]
    assert group_curve(felt, LIBRARY, (0.4, 300.0)).curve.provenance == "measured"
    other = [replace(one, study_number=2, level_db_re_1um=one.level_db_re_1um + 8.0) for one in felt]
    both = group_curve([*felt, *felt, *other], LIBRARY, (0.4, 300.0))  # S1 of study 1 came twice
    assert both.subjects == (0, 2, 2, 2, 0)
    assert both.curve.level_db_re_1um[1:4] == pytest.approx([one.level_db_re_1um + 4.0 for one in felt])
    assert [one.name for one in person_thresholds([*felt, *other])] == ["S1-1", "S1-2"]
    assert set(dict(psychometric_trials(detection_runs(study[0]), felt))) == {"S1"}
    store, _ = study
    runs = detection_runs(store)
    everybody = group_curve(thresholds(runs), LIBRARY, (0.4, 300.0))
    with pytest.raises(BadInput, match="no point is measured"):
        write_curve(tmp_path / "curve.csv", everybody.curve, circumstances(everybody, runs))
    kept = [one for one in thresholds(runs) if one.subject == "S1" or one.frequency_hz == 200.0]
    group = group_curve(kept, LIBRARY, (0.4, 300.0))
    assert group.curve.covers(0.4, 300.0)
    write_curve(tmp_path / "curve.csv", group.curve, circumstances(group, runs))
    back = read_curve(tmp_path / "curve.csv")
    assert back.provenance == back.name == "simulated"
    assert "nobody felt it" in back.source
    assert back.level_db_re_1um == pytest.approx(group.curve.level_db_re_1um, abs=1e-3)
    assert back.bound == group.bound == ("", "", "", ">=", ">=")
    assert back.bounds_said == "known from one side alone, >= at 200, >= at 300 Hz"
    assert back.bounds_said in thresholds_figure(person_thresholds(kept), LIBRARY, back).caption
    with pytest.raises(BadInput, match="no point is measured"):
        with_curve(controller().display, everybody.curve)
    designed = with_curve(controller().display, back)
    assert any(back.bounds_said in notice for notice in designed.channels[0].contact_notices())
    document = display_document(designed)
    assert parse_display(document).channels[0].threshold.curve.bound == back.bound
    lines = [line for line in (tmp_path / "curve.csv").read_text().splitlines() if not line.startswith("#")]
    row = next(csv.DictReader(lines))
    assert (row["contact_area_mm2"], row["site"], row["surround"]) == ("78.5", "", "")
    assert row["subject_group"] == "hearing;hearing-impaired"
    assert (row["finger"], row["experimenter"], row["masking_sound"], row["preload_n"]) == ("index", "EX", "pink", "")
    with pytest.raises(BadInput, match="2 measured frequencies"):
        group_curve([one for one in thresholds(runs) if one.frequency_hz < 100.0], LIBRARY, (0.4, 300.0))
    with pytest.raises(BadInput, match="4 trials"):
        refit(np.zeros(4), np.ones(4, dtype=bool))


def delivered_level(commanded, measured, *hertz_and_level):
    gain = delivered_levels([commanded], [measured], *(np.array([value]) for value in hertz_and_level))
    return SimpleNamespace(offset_db=gain.offset_db.item(), sd_db=gain.sd_db.item())


@pytest.mark.parametrize(("frequency_hz", "limit_db"), [(298.0, 0.2), (10.0, 1.0)])
def test_delivered__display_a_decibel_low_in_noise__is_found_with_its_error(frequency_hz, limit_db) -> None:
    """At 298 Hz and -4 dB SL by the loud trials of the run; below 25 Hz by those near threshold alone."""
    errors, stated = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        level = np.concatenate([[20.0] * 3, [16.0] * 3, [12.0] * 3, rng.integers(-7, 0, 60).astype(float)])
        hum = 0.3 * (rng.standard_normal((2, 2 * level.size)) @ np.diag(np.ones(2 * level.size)))
        blank = 20 * np.log10(np.hypot(*hum[:, : level.size]))
        gain = 10 ** ((level - 1.0) / 20)
        seen = 20 * np.log10(np.hypot(gain + hum[0, level.size :], hum[1, level.size :]))
        commanded = np.concatenate([np.full(level.size, np.nan), level])
        found = delivered_level(commanded, np.concatenate([blank, seen]), frequency_hz, -4.0)
        errors.append(found.offset_db + 1.0)
        stated.append(found.sd_db)
    assert float(np.std(errors)) <= limit_db
    assert float(np.mean(stated)) == pytest.approx(float(np.std(errors)), rel=0.5)
    assert abs(float(np.mean(errors))) <= 0.1
    unknown = delivered_level(np.array([np.nan, 30.0]), np.array([0.0, 30.0]), frequency_hz, 0.0)  # nothing near
    assert np.isnan(unknown.offset_db) == (frequency_hz < 25.0)
    assert np.isnan(delivered_level(np.array([np.nan]), np.array([0.0]), frequency_hz, 0.0).offset_db)


@pytest.mark.parametrize("frequency_hz", [298.0, 32.0, 10.0])
def test_delivered__friction_takes_more_of_weak_tones__is_that_near_threshold(frequency_hz) -> None:
    rng = np.random.default_rng(5)
    level = np.concatenate([rng.uniform(20.0, 35.0, 12), rng.normal(14.0, 2.0, 50)])
    asked = 10 ** (level / 20)
    moved = np.maximum(asked - 3.0, 0.05) * 10 ** (rng.normal(0.0, 0.3, level.size) / 20)
    commanded = np.concatenate([np.full(level.size, np.nan), level])
    seen = 20 * np.log10(np.hypot(np.concatenate([np.full(level.size, 0.05), moved]), 0.05))
    at = delivered_level(commanded, seen, frequency_hz, 14.0)
    assert at.offset_db == pytest.approx(20 * np.log10((10 ** (14.0 / 20) - 3.0) / 10 ** (14.0 / 20)), abs=1.0)


@pytest.mark.parametrize("mains_hz", [60.0, 50.0, 0.0])
def test_played_at__whole_curve_at_other_mains__has_the_frequencies_played(mains_hz) -> None:
    head, tail = TEXT.split("[procedure]")[0], TEXT[TEXT.index("[conditions]") :]
    protocol = parse_protocol(
        f'{head}[procedure]\nkind = "curve"\n{tail}'.replace("frequencies_hz = [8, 30, 200]\n", ""), Protocol
    )
    hertz = WholeCurve().places(Playable((0.4, 300.0), mains_hz, 4.0))
    about = SimpleNamespace(band_low_hz=0.4, band_high_hz=300.0)
    run = StoredRun(None, about, protocol, hertz, 0.0 * hertz, 0.0 * hertz, hertz > 0.0, None)  # type: ignore[arg-type]
    assert protocol.procedure.places(played_at(run)) == pytest.approx(hertz)


def test_whole_curve__through_the_display__follows_the_truth(store) -> None:
    head = PROTOCOL[: PROTOCOL.index("[procedure]")] + '[procedure]\nkind = "curve"\ntrials = 60\n'
    rest = PROTOCOL[PROTOCOL.index("[timing]") : PROTOCOL.rindex("[[subject]]")]
    text = head + '[conditions]\nfingers = ["index"]\n' + rest
    observers = simulated_observers(LIBRARY, 1, seed=2)
    run_study(store, parse_protocol(text, Protocol), text, apparatus(), observers, SystemClock(), "finger")
    runs = detection_runs(store)
    found = thresholds(runs)
    (drawn,) = dict(psychometric_trials(runs, found))["S1"]
    assert drawn.whole_curve
    assert drawn.count.sum() == 60
    assert drawn.threshold.refit_db_sl == pytest.approx(0.0, abs=2.5)  # curve and function tell the same story
    figure = psychometric_figure("S1", [drawn])
    assert "relative to the run's own curve" in figure.caption
    assert figure.drawing.axes[0].get_title().startswith("index, whole curve")
    truth = observers[0].curve.level_db_re_1um_at([one.frequency_hz for one in found])
    errors = np.array([one.level_db_re_1um for one in found]) - truth
    assert float(np.sqrt(np.mean(errors**2))) < 3.5
    assert found[0].trials == 60
    assert len(found) == 28  # every frequency at which trials may be put
    assert all(one.notch_trials is not None and one.notch_trials >= 0 for one in found)
    assert any(one.notch_trials for one in found)  # sixty trials cannot exclude a notch everywhere


def test_thresholds_figure__many_people__have_one_line_of_the_legend(study) -> None:
    """Four thousand lines of it left the axes no room, and each person took up memory."""
    (person,) = person_thresholds(thresholds(detection_runs(study[0]))[:1])
    many = [replace(person, name=f"S{number}") for number in range(31)]
    drawn = thresholds_figure(many, LIBRARY, None)
    labels = [text.get_text() for text in drawn.drawing.axes[0].get_legend().get_texts()]
    assert labels[1:] == ["31 people"]
    assert drawn.table["person"] == [one.name for one in many]
