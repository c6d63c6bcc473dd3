"""Devices of others: Android profiles by the published formula, configuration files in JSON5; and TAPS's codes."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.patterns.acf import acf_text, parse_json5, read_acf
from tactuator.patterns.android import FrequencyProfile, profile_text, read_profile, threshold_db_g
from tactuator.patterns.clip import Tap
from tactuator.patterns.rendering import android_map
from tactuator.patterns.taps import (
    CODES,
    SpokenPhoneme,
    alike,
    code_phonemes,
    duration_s,
    felt_levels_db,
    phonemes_of,
    usual_layout,
)
from tactuator.perception.curve import curve
from tactuator.synthesis.design import design_controller
from tactuator.verbs.parameters import paper_display
from tests.patterns.formats import ACF

HERTZ = [90.0, 120.0, 150.0, 60.0, 30.0, 210.0, 270.0, 300.0, 240.0, 180.0]
GS = [1.2, 1.8, 2.4, 0.6, 0.1, 2.2, 1.0, 0.5, 1.9, 3.0]
BESIDE = {  # threshold at a frequency, or at the two beside it
    30: [(30.0, -34.31)], 60: [(60.0, -31.77)], 90: [(90.0, -31.73)], 120: [(103.68, -31.77), (124.42, -31.70)],
    135: [(124.42, -31.70), (149.3, -31.38)], 150: [(150.0, -31.35)], 180: [(179.16, -31.02), (200.0, -30.86)],
    210: [(200.0, -30.86), (215.0, -30.35)], 240: [(215.0, -30.35), (250.0, -28.98)],
    270: [(258.0, -28.68), (300.0, -26.81)], 300: [(300.0, -26.81)],
}  # fmt: skip


@pytest.fixture
def profile(tmp_path):
    path = tmp_path / "phone.csv"
    rows = "".join(f"{hertz},{g}\n" for hertz, g in zip(HERTZ, GS, strict=True))
    path.write_text("frequency_hz,acceleration_g\n" + rows)
    return read_profile(path)


def between(points, hertz):
    if len(points) == 1:
        return points[0][1]
    (f, a), (g, b) = points
    return a + (b - a) * (hertz - f) / (g - f)


def greatest_g(hertz):
    known = sorted(zip(HERTZ, GS, strict=True))
    pair = next(((p, q) for p, q in pairwise(known) if p[0] <= hertz <= q[0]))
    return between(pair, hertz)


def test_intensity__on_the_published_profile__becomes_the_published_amplitude(profile) -> None:
    """amplitude = min(1, 10^((I SLmax + thr)/20) / FOAM), SLmax = 20 log10(3.0) - thr(180 Hz), within 0.1 %."""
    full = 20.0 * math.log10(3.0) - between(BESIDE[180], 180.0)
    assert profile.full_db_sl == pytest.approx(full, abs=1e-9)
    assert full == pytest.approx(40.6, abs=0.05)
    for intensity in (0.0, 0.05, 0.25, 0.5, 0.75, 0.9, 1.0):
        for hertz, points in BESIDE.items():
            wanted_g = 10.0 ** ((intensity * full + between(points, hertz)) / 20.0)
            amplitude = min(1.0, wanted_g / greatest_g(hertz)) if intensity else 0.0
            assert float(profile.amplitude(intensity, hertz)) == pytest.approx(amplitude, rel=1e-3)


@pytest.mark.parametrize(
    ("intensity", "hertz", "missing_db"), [(1.0, 30.0, 26.0), (1.0, 60.0, 13.0), (1.0, 300.0, 20.0), (0.5, 30.0, 6.0)]
)
def test_intensity__of_1__falls_short_where_the_device_is_weak(profile, intensity, hertz, missing_db) -> None:
    missing = intensity * profile.full_db_sl - float(profile.headroom_db_sl(hertz))
    assert missing == pytest.approx(missing_db, abs=0.5)


def test_profile__of_the_unit_test_or_weak__has_its_band_is_refused_and_is_read_back(profile, tmp_path) -> None:
    assert profile.band_hz == (30.0, 300.0)
    asked = android_map(profile, "android-basic")
    assert (asked.strength, asked.band_hz, asked.full_db_sl) == ("level", (30.0, 300.0), profile.full_db_sl)
    weak_at_ends = FrequencyProfile(np.array([50.0, 100.0, 200.0, 300.0]), np.array([0.01, 1.0, 1.0, 0.01]))
    low, high = weak_at_ends.band_hz  # the platform's own test: it begins and ends between points
    assert 50.0 < low < 100.0
    assert 200.0 < high < 300.0
    assert low == pytest.approx(50.0 + 50.0 * (10.0 ** ((10.0 - 31.90) / 20.0) - 0.01) / 0.99, abs=1e-9)
    weak = FrequencyProfile(np.array([50.0, 100.0]), np.array([0.01, 0.02]))
    with pytest.raises(BadInput, match="dB SL at most; allowed: 10 dB SL somewhere"):
        android_map(weak, "android-basic")
    (tmp_path / "b.csv").write_text(profile_text(profile, ["of a phone"]))
    np.testing.assert_allclose(read_profile(tmp_path / "b.csv").acceleration_g, profile.acceleration_g, rtol=1e-5)


def test_threshold__of_the_platform__is_our_curve_as_an_acceleration() -> None:
    hertz = np.array([0.4, 3.0, 10.0, 30.0, 60.0, 100.0, 200.0, 300.0, 400.0])
    peak_g = curve("bolanowski-1988").displacement_mm(hertz) * 1e-3 * (2.0 * np.pi * hertz) ** 2 / 9.80665
    np.testing.assert_allclose(threshold_db_g(hertz), 20.0 * np.log10(peak_g), atol=0.02)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frequency_hz,g\n1,2\n3,4\n", "columns frequency_hz, g; allowed: frequency_hz and acceleration_g"),
        ("frequency_hz,acceleration_g\n1,2\n", "1 frequencies"),
        ("frequency_hz,acceleration_g\n1,2\n1,3\n", "not in order"),
        ("frequency_hz,acceleration_g\n1,2\n2,0\n", "an acceleration of 0 g"),
        ("frequency_hz,acceleration_g\n1,2\n2,x\n", "a cell that is no number"),
        ("", "columns nothing"),
    ],
)
def test_profile__that_is_none__is_refused_with_the_reason(tmp_path, text, said) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(BadInput, match=f"a.csv: .*{said}"):
        read_profile(tmp_path / "a.csv")


def read(tmp_path, text=ACF):
    path = tmp_path / "a.acf"
    path.write_text(text)
    return read_acf(path)


def test_acf__in_json5__is_the_map_that_it_states_written_back_and_its_squares_fundamentals(tmp_path) -> None:
    mapping = read(tmp_path)
    assert (mapping.band_hz, mapping.gain, mapping.ducking) == ((55.0, 200.0), 0.8, 0.75)
    assert (mapping.tap_hz, mapping.tap_s) == ((55.0, 165.0), pytest.approx((0.0364, 0.0121)))
    assert (mapping.tap_gain, mapping.tap_fade, mapping.tap_shape) == (1.0, 0.5, ("sine", "square"))
    assert read(tmp_path, acf_text(mapping, "a device", "2026-01-02")) == mapping
    time = np.arange(4096) / 4096
    square = np.where(time % 0.125 < 0.0625, 1.0, -1.0)  # eight periods: its line in the spectrum is the eighth
    fundamental = 2.0 * np.abs(np.fft.rfft(square)[8]) / square.size
    sine, sharp = (mapping.tap_amplitude(Tap(0.0, 1.0, pitch), 100.0) for pitch in (0.0, 1.0))
    assert sharp / sine == pytest.approx(fundamental, rel=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("gain: .8", "gain: 1.8", "continuous: gain is 1.8; allowed: 0 to 1"),
        ("gain: .8, ", "", "continuous: gain is missing"),
        ("frequency_min: 55,", "frequency_min: 300,", "frequency_max is 200; allowed: 300 or more"),
        ("'sine'", "'round'", "shape is 'round'; allowed: sine, square, triangle, saw"),
        ("duration_ms: 36.4", "duration_ms: 0", "duration_ms is 0"),
        ("fade_out_percent: 50", "fade_out_percent: 150", "fade_out_percent is 150; allowed: 0 to 100"),
        ("emphasis: {", "emphases: {", "emphasis is missing"),
        ("frequency_min: {", "frequency_min: 3, a: {", "frequency_min is 3; allowed: a table"),
        ("gain: .8", "gain: NaN", "it holds NaN"),
        ("{", "{,", "it is not JSON"),
    ],
)
def test_acf__rule_broken__is_refused_with_it(tmp_path, old, new, said) -> None:
    with pytest.raises(BadInput, match=f"a.acf: .*{said}"):
        read(tmp_path, ACF.replace(old, new, 1))


ANY = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)  # fmt: skip


@given(ANY)
def test_json5__json__is_read_as_json_is(value) -> None:
    text = json.dumps(value, ensure_ascii=False)
    assert parse_json5(text) == json.loads(text)


def test_json5__what_json_does_not_have__is_read() -> None:
    """The example of json5.org, in its kinds: comments, names, quotes, numbers, commas at the end."""
    text = """// comment
    {unquoted: 'and you can "quote" me', single: 'it\\'s \\x41', lines: "no \\\nbreak", hex: 0xdecaf,
     lead: .8675309, trail: 8675309., plus: +1, null: null, $a_1: [true, -.5e2, 1.e3,], /* in * between */ "last": {},}
    """
    assert parse_json5(text) == {
        "unquoted": 'and you can "quote" me', "single": "it's A", "lines": "no break", "hex": 0xDECAF,
        "lead": 0.8675309, "trail": 8675309.0, "plus": 1, "null": None, "$a_1": [True, -50.0, 1000.0], "last": {},
    }  # fmt: skip


@pytest.mark.parametrize(
    "text",
    ["", "[,]", "{,}", "[1,,2]", "{a:1,,}", "{a b}", "1 2", "[1],", "foo", "{a:foo}", "/* open", "'a\nb'", "@", "01",
     "[" * 100_000, "{a:Infinity}", "{a:0x}", "+", '"' + "x" * (1 << 20)],
)  # fmt: skip
def test_json5__other_text__is_refused(text) -> None:
    with pytest.raises(BadInput):
        parse_json5(text)


HEAD = 'File type = "ooTextFile"\nObject class = "TextGrid"\n\n'


def tier(number: int, name: str, *spoken: tuple[float, float, str]) -> str:
    rows = [f"    item [{number}]:", '        class = "IntervalTier"', f'        name = "{name}"']
    rows += ["        xmin = 0", "        xmax = 1.2", f"        intervals: size = {len(spoken)}"]
    for k, (start, end, text) in enumerate(spoken, 1):
        rows.append(f"        intervals [{k}]:")
        rows += [f"            xmin = {start}", f"            xmax = {end}", f'            text = "{text}"']
    return "\n".join(rows) + "\n"


WORDS = tier(1, "words", (0, 1.2, 'he said ""no"" twice'))
PHONES = tier(2, "phones", (0, 0.25, ""), (0.25, 0.5, "N"), (0.5, 1.2, "OW1"))
LONG_GRID = HEAD + "xmin = 0\nxmax = 1.2\ntiers? <exists>\nsize = 2\nitem []:\n" + WORDS + PHONES
SHORT_GRID = HEAD + '0\n1.2\n<exists>\n2\n"IntervalTier"\n'


@pytest.fixture(scope="module")
def controller():
    return design_controller(paper_display())


def test_codes__39__as_long_as_published_and_laid_out_on_24_tactors_or_fewer():
    assert len(CODES) == 39
    assert {name for name in CODES if duration_s(name) == 0.14} == set("PTKBDG")
    short = {name for name in CODES if 0.23 < duration_s(name) < 0.25}
    assert short == {"IH", "EH", "UH", "UU"}
    assert all(0.36 < duration_s(name) < 0.401 for name in set(CODES) - short - set("PTKBDG"))
    (burst,) = CODES["B"]
    first, wave = burst.wave(8000.0, burst.carrier_hz)
    time = np.arange(1120) / 8000.0
    rise = 0.5 * (1.0 - np.cos(np.pi * np.minimum(np.minimum(time, 0.14 - time), 0.005) / 0.005))
    expected = rise**2 * np.sin(600.0 * np.pi * time) * (1.0 + 0.5 * np.sin(60.0 * np.pi * time))
    assert (first, burst.tactors, wave.size) == (0, (16, 17, 20, 21), 1120)
    share = np.dot(wave, expected) / np.dot(expected, expected)
    assert np.allclose(wave, share * expected, atol=1e-9)
    assert usual_layout(24) == usual_layout(30) == tuple(range(24))
    assert alike(usual_layout(24)) == ()
    assert usual_layout(3) == (0,) * 8 + (1,) * 8 + (2,) * 8
    assert ("F", "SH") in alike(usual_layout(3))
    with pytest.raises(BadInput, match="8 channels and no layout"):
        usual_layout(8)


@given(st.sampled_from(sorted(CODES)), st.floats(0.0, 3.0), st.sampled_from([4000.0, 8000.0, 44100.0]))
def test_wave__any_burst_at_any_time__has_the_energy_of_its_window(name, code_s, rate_hz):
    for burst in CODES[name]:
        first, wave = burst.wave(rate_hz, burst.carrier_hz, code_s)
        at = np.arange(first, first + wave.size) / rate_hz - code_s - burst.start_s
        assert at[0] >= -1e-9
        assert at[-1] <= burst.duration_s
        edge = np.clip(np.minimum(at, burst.duration_s - at) / burst.transition_s, 0.0, 1.0)
        assert np.sum(wave**2) == pytest.approx(0.5 * np.sum(np.sin(0.5 * np.pi * edge) ** 8), rel=0.06)


@pytest.mark.parametrize("text", ["HH AH0 L OW1", "hh, ah, l, ow", "SIL HH AH L OW sp"])
def test_phonemes__of_a_string__are_by_taps_names(text):
    assert [each.name for each in phonemes_of(text)] == ["H", "UH", "L", "OE"]
    assert phonemes_of("J AY", "taps") == (SpokenPhoneme("J"), SpokenPhoneme("AY"))


def test_phonemes__of_a_textgrid_in_either_form_or_a_table__are_those_of_its_phones(tmp_path):
    grid = tmp_path / "a.TextGrid"
    grid.write_text(LONG_GRID)
    assert phonemes_of(str(grid)) == (SpokenPhoneme("N", 0.25), SpokenPhoneme("OE", 0.5))
    values = [line.partition("=")[2].strip() for line in LONG_GRID.splitlines()[8:] if "=" in line]
    (tmp_path / "b.TextGrid").write_text("\n".join([*LONG_GRID.splitlines()[:3], "0", "1.2", "<exists>", "2", *values]))
    assert phonemes_of(str(tmp_path / "b.TextGrid")) == phonemes_of(str(grid))
    (tmp_path / "a.csv").write_text("start_s,end_s,phoneme\n0.1,0.2,B\n0.2,0.4,IY\n")
    assert phonemes_of(str(tmp_path / "a.csv")) == (SpokenPhoneme("B", 0.1), SpokenPhoneme("EE", 0.2))


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.csv", "start_s,phoneme\n0.4,B\n0.2,IY\n", "go back"),
        ("a.csv", "start_s,phoneme\nsoon,B\n", "soon"),
        ("a.csv", "phoneme\nB\n", "columns phoneme"),
        ("a.txt", "B QQ\n", "QQ"),
        ("a.txt", "sil sp\n", "0 phonemes"),
        ("a.TextGrid", SHORT_GRID, "damaged"),
        ("a.TextGrid", LONG_GRID.replace('"phones"', '"letters"'), "tiers words, letters"),
        ("a.TextGrid", LONG_GRID[: LONG_GRID.index("intervals [3]")], "damaged"),
        ("a.TextGrid", "nothing of the kind", "tiers none"),
    ],
)
def test_phonemes__file_that_is_none__is_refused(tmp_path, name, content, told):
    (tmp_path / name).write_text(content)
    with pytest.raises(BadInput, match=told):
        phonemes_of(str(tmp_path / name))


def test_code__on_three_fingers__bursts_at_their_times_and_levels(controller):
    coded = code_phonemes([SpokenPhoneme("T", 0.1), SpokenPhoneme("F", 0.15)], controller, 30.0)
    assert [each.start_s for each in coded.spoken] == pytest.approx([0.1, 0.29])
    assert coded.delayed_s == pytest.approx(0.14)
    envelope = np.abs(coded.reference)
    begins = [np.flatnonzero(column)[0] / controller.rate_hz if column.any() else None for column in envelope.T]
    assert begins[0] is None
    assert begins[1:] == pytest.approx([0.1, 0.29], abs=0.001)
    assert envelope.max(axis=0)[1:] == pytest.approx([10**1.5] * 2, rel=0.02)


@pytest.mark.parametrize(
    ("spoken", "layout", "told"),
    [([], None, "no phoneme"), ([SpokenPhoneme("XX")], None, "'XX'"), ([SpokenPhoneme("B")], [0] * 23, "23 tactors"),
     ([SpokenPhoneme("B")], [3] * 24, "24 tactors onto")],
)  # fmt: skip
def test_code__that_cannot_be__is_refused(controller, spoken, layout, told):
    with pytest.raises(BadInput, match=told):
        code_phonemes(spoken, controller, 30.0, layout)


def test_levels__of_fingers_of_unlike_gain__are_equal_as_designed(controller):
    """A finger of twice the sensitivity is felt 6 dB more by one gain, and no more as designed."""
    channels = list(controller.display.channels)
    channels[1] = replace(channels[1], plant=replace(channels[1].plant, gain=2.0 * channels[1].plant.gain))
    again = design_controller(replace(controller.display, channels=tuple(channels)))
    plain, louder = (felt_levels_db(each, 30.0, usual_layout(3)) for each in (controller, again))
    raised = louder["T"][0] - louder["P"][0] - (plain["T"][0] - plain["P"][0])
    assert raised == pytest.approx(20.0 * np.log10(2.0), abs=1e-6)
    designed = [last for _, last in louder.values()]
    assert max(designed) - min(designed) < 1.0
    assert np.mean([first for first, _ in louder.values()]) == pytest.approx(30.0)


def test_verb__set_of_all__is_an_experiment_that_runs(tmp_path, controller, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    write_controller(tmp_path / "c.json", controller)
    code = ("--controller", "c.json", "--out")
    told = run.json("phonemes", "all", *code, "set")
    assert (len(told["references"]), len(told["levels"]), told["met"]) == (39, 39, True)
    assert "a reduced code: 24 tactors on 3 channels" in run("phonemes", "HH AY", *code, "hi.wav").err
    (tmp_path / "layout.csv").write_text("tactor,channel\n" + "".join(f"{n},thumb\n" for n in range(1, 24)))
    run.refused("phonemes", "B", *code, "b.wav", "--layout", "layout.csv", said="each tactor of 1 to 24 once")
    run.refused("phonemes", "B", *code, "b.wav", "--notation", "ipa", said="ipa")
