"""TAPS's codes against waves written out here, phonemes read from files, and their levels on unlike tactors."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.io.shipped import EXAMPLES
from tactuator.paper.plan import paper_display
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
from tactuator.synthesis.design import design_controller

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


def test_codes__39__as_long_as_published():
    assert len(CODES) == 39
    assert {name for name in CODES if duration_s(name) == 0.14} == set("PTKBDG")
    short = {name for name in CODES if 0.23 < duration_s(name) < 0.25}
    assert short == {"IH", "EH", "UH", "UU"}
    assert all(0.36 < duration_s(name) < 0.401 for name in set(CODES) - short - set("PTKBDG"))


def test_wave__of_b__is_300_hz_modulated_at_30_in_a_squared_tukey_window():
    (burst,) = CODES["B"]
    first, wave = burst.wave(8000.0, burst.carrier_hz)
    time = np.arange(1120) / 8000.0
    rise = 0.5 * (1.0 - np.cos(np.pi * np.minimum(np.minimum(time, 0.14 - time), 0.005) / 0.005))
    expected = rise**2 * np.sin(600.0 * np.pi * time) * (1.0 + 0.5 * np.sin(60.0 * np.pi * time))
    assert (first, burst.tactors, wave.size) == (0, (16, 17, 20, 21), 1120)
    share = np.dot(wave, expected) / np.dot(expected, expected)
    assert np.allclose(wave, share * expected, atol=1e-9)


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


def test_layout__24_up_to_six_or_ones_own():
    assert usual_layout(24) == usual_layout(30) == tuple(range(24))
    assert alike(usual_layout(24)) == ()
    assert usual_layout(3) == (0,) * 8 + (1,) * 8 + (2,) * 8
    assert ("F", "SH") in alike(usual_layout(3))
    with pytest.raises(BadInput, match="8 channels and no layout"):
        usual_layout(8)


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


def test_verb__set_of_all__is_an_experiment_that_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shown = str(EXAMPLES / "display.toml")
    assert main(["design", shown, "--out", "c.json"]) in (0, None)
    capsys.readouterr()
    assert main(["phonemes", "all", "--controller", "c.json", "--out", "set", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (len(told["references"]), len(told["levels"]), told["met"]) == (39, 39, True)
    assert main(["phonemes", "HH AY", "--controller", "c.json", "--out", "hi.wav"]) == 0
    assert "a reduced code: 24 tactors on 3 channels" in capsys.readouterr().err
    (tmp_path / "layout.csv").write_text("tactor,channel\n" + "".join(f"{n},thumb\n" for n in range(1, 24)))
    assert main(["phonemes", "B", "--controller", "c.json", "--out", "b.wav", "--layout", "layout.csv"]) == 2
    assert "each tactor of 1 to 24 once" in capsys.readouterr().err
    assert main(["phonemes", "B", "--controller", "c.json", "--out", "b.wav", "--notation", "ipa"]) == 2
