"""The printed digits of a controller's figures and findings, against texts written out by hand."""

from types import SimpleNamespace

from tactuator.model.verdict import Finding, Outcome
from tactuator.report.tables import design_rows, finding_row, load_words, remark_lines

REPORT = {
    "margins": {
        "crossover_hz": 21.23456,
        "phase_margin_deg": 44.999,
        "gain_margin_db": None,
        "least_gain": 0.0372,
        "sensitivity_peak": 1.7049,
        "complementary_peak": 1.2,
        "disk_margin": 0.5051,
        "delay_margin_samples": 23.0,
        "command_noise_gain": 12.345,
    },
    "rejection_db": {"mean": -12.3449},
    "prefilter": {"poles": 6, "max_error_db": 0.2951, "rms_error_db": 0.1},
    "mains_db": {"120": -9.005, "60": -3.14159},
}


def test_design_rows__of_a_report__print_two_digits_after_the_point():
    assert list(design_rows([SimpleNamespace(report=REPORT)])) == [
        ("crossover (Hz)", "21.23"),
        ("phase margin (deg)", "45.00"),
        ("gain margin (dB)", "—"),
        ("unstable below this gain (1: as designed)", "0.04"),
        ("max|S|", "1.70"),
        ("max|T|", "1.20"),
        ("disk margin", "0.51"),
        ("delay margin (samples)", "23.00"),
        ("command noise gain", "12.35"),
        ("mean |S| over the rejection band (dB)", "-12.34"),
        ("prefilter: poles", "6"),
        ("prefilter: greatest error (dB)", "0.30"),
        ("prefilter: rms error (dB)", "0.10"),
        ("|T| at 60 Hz (dB)", "-3.14"),
        ("|T| at 120 Hz (dB)", "-9.01"),
    ]


def test_finding_row__with_and_without_a_value__prints_two_digits_and_four_of_the_frequency():
    found = Finding("iv", "index", "finger", Outcome.NOT_MET, "felt hum", 3.14159, 0.5, "dB SL", 59.99951)
    shown = ("iv", "index", "not met", "felt hum 3.14 dB SL", "0.5 dB SL", "60 Hz", "finger")
    assert finding_row(found) == shown
    bare = Finding("build", "thumb", "none", Outcome.NOT_JUDGED, "float32")
    assert finding_row(bare) == ("build", "thumb", "not judged", "float32", "", "", "free")


def test_load_words__load_and_member_of_a_family__are_plain():
    assert [load_words(name) for name in ("none", "finger", "none, model 2", "finger, model 3")] == [
        "free", "finger", "free, plant 2 of the family", "finger, plant 3 of the family",
    ]  # fmt: skip


def test_remark_lines__the_same_of_several_objectives_and_channels__one_line():
    twice = [Finding(name, "c", "none", Outcome.NOT_JUDGED, "x", remark="nothing tells") for name in ("i", "ii", "i")]
    same = [Finding("iv", name, "none", Outcome.NOT_JUDGED, "change", remark="no load") for name in ("a", "b", "c")]
    other = Finding("ii", "b", "none", Outcome.NOT_MET, "felt hum", remark="less hum")
    quiet = Finding("i", "a", "none", Outcome.MET, "error")
    assert remark_lines([quiet, *same, other]) == ["iv, a, b, c: no load", "ii, b: less hum"]
    assert remark_lines(twice) == ["i, ii, c: nothing tells"]
