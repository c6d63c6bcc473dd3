"""TAPS: its codes, where they are laid out, and the TextGrids that ask for them."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.api.parameters import paper_display
from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.speech.limiter import Limiter
from tactuator.speech.render import RenderJob, render_file
from tactuator.speech.taps import CODES, Phoneme, alike, duration_s, taps_signal, usual_layout
from tactuator.speech.textgrid import read_textgrid
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


def test_textgrid__in_either_form_with_other_tiers__has_its_phones_by_taps_names(tmp_path):
    grid, other = tmp_path / "a.TextGrid", tmp_path / "b.TextGrid"
    grid.write_text(LONG_GRID)
    assert read_textgrid(grid) == (Phoneme("N", 0.25), Phoneme("OE", 0.5))
    values = [line.partition("=")[2].strip() for line in LONG_GRID.splitlines()[8:] if "=" in line]
    other.write_text("\n".join([*LONG_GRID.splitlines()[:3], "0", "1.2", "<exists>", "2", *values]), encoding="utf-16")
    assert read_textgrid(other) == read_textgrid(grid)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (HEAD + tier(1, "a", (0.4, 0.5, "B"), (0.2, 0.4, "IY")), "go back"),
        (HEAD + "0 1.2 <exists> 1" + tier(1, "a", (1.0, 1.3, "B")), "'B' from 1 to 1.3 s, and its tier or file"),
        (HEAD + "0 9999 <exists> 1" + tier(1, "a", (4e3, 5e3, "B")).replace("1.2", "9999"), "beyond 0 to 3600 s"),
        (HEAD + tier(1, "a", (0.4, 0.5, "QQ")), "phoneme 'QQ'; expected ARPAbet, as of MFA"),
        (HEAD + tier(1, "a", (0.4, 0.5, "sil")), "0 phonemes"),
        (SHORT_GRID, "damaged"),
        (LONG_GRID.replace('"phones"', '"letters"'), "tiers words, letters"),
        (LONG_GRID[: LONG_GRID.index("intervals [3]")], "damaged"),
        ("nothing of the kind", "tiers none"),
    ],
)
def test_textgrid__that_is_none__is_refused(tmp_path, content, told):
    (tmp_path / "a.TextGrid").write_text(content)
    with pytest.raises(BadInput, match=f"a.TextGrid: .*{told}"):
        read_textgrid(tmp_path / "a.TextGrid")


def test_textgrid__pipe_without_a_writer_or_a_name_with_nul__is_refused(tmp_path):
    os.mkfifo(tmp_path / "a.TextGrid")
    for path in (tmp_path / "a.TextGrid", Path("a\0b")):
        with pytest.raises(BadInput):
            read_textgrid(path)


def test_textgrid__from_a_pipe__is_read_once_and_render_refuses_what_it_cannot_read_again(tmp_path, controller):
    pipe = tmp_path / "a.TextGrid"
    os.mkfifo(pipe)
    writer = os.open(pipe, os.O_RDWR)
    os.write(writer, LONG_GRID.encode())
    threading.Timer(0.2, os.close, (writer,)).start()
    assert read_textgrid(pipe) == (Phoneme("N", 0.25), Phoneme("OE", 0.5))
    for name in ("a.TextGrid", "a.wav", "a.haptic"):
        if name != pipe.name:
            os.mkfifo(tmp_path / name)
        with pytest.raises(BadInput, match=f"{name}: it is no file"):
            render_file(tmp_path / name, tmp_path / "out.wav", RenderJob(controller))


def test_taps_signal__on_three_fingers__bursts_at_their_times_and_levels(controller):
    signal = taps_signal([Phoneme("T", 0.1), Phoneme("F", 0.15)], controller, 30.0)
    assert [each["start_s"] for each in signal.about["phonemes"]] == pytest.approx([0.1, 0.29])
    assert signal.notes[-1] == "codes wait for the one before by up to 0.14 s"
    envelope = np.abs(np.concatenate(list(Limiter(controller).process(signal.blocks))))
    assert not signal.loss(envelope).shortfall_db_sl
    begins = [np.flatnonzero(column)[0] / controller.rate_hz if column.any() else None for column in envelope.T]
    assert begins[0] is None
    assert begins[1:] == pytest.approx([0.1, 0.29], abs=0.001)
    assert envelope.max(axis=0)[1:] == pytest.approx([10**1.5] * 2, rel=0.02)


@pytest.mark.parametrize(("layout", "told"), [([0] * 23, "23 tactors"), ([3] * 24, "24 tactors onto")])
def test_taps_signal__layout_that_does_not_fit__is_refused(controller, layout, told):
    with pytest.raises(BadInput, match=told):
        taps_signal([Phoneme("B")], controller, 30.0, layout)


def test_verbs__alignment_and_set_of_all__are_references_that_run(tmp_path, controller, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    write_controller(tmp_path / "c.json", controller)
    (tmp_path / "no.TextGrid").write_text(LONG_GRID)
    code = ("--controller", "c.json", "--out")
    told = run.json("experiment", "phonemes", *code, "set")
    assert (len(told["items"]), told["notes"][0]) == (39, "a reduced code: 24 tactors on 3 channels")
    observed = ("experiment", "recognise", told["protocol"], "--store", "lab.db", "--scripted-error", "0.1")
    assert run.json(*observed, "--controller", "c.json")["trials"] == 39 * (2 + 4)
    spoken = run.json("render", "no.TextGrid", *code, "no.wav")
    assert [each["name"] for each in spoken["phonemes"]] == ["N", "OE"]
    (tmp_path / "layout.csv").write_text("tactor,channel\n" + "".join(f"{n},thumb\n" for n in range(1, 24)))
    run.refused("render", "no.TextGrid", *code, "b.wav", "--layout", "layout.csv", said="each tactor of 1 to 24 once")
    with (tmp_path / "layout.csv").open("a") as rest:
        rest.write("24,index\n")
    assert run.json("render", "no.TextGrid", *code, "b.wav", "--layout", "layout.csv")["layout"] == [1] * 23 + [0]


def short_form(*tiers, size=None):
    """A TextGrid in Praat's short text form; size: stated of each tier, for its own."""
    lines = ["0", "2", "<exists>", str(len(tiers))]
    for name, spans in tiers:
        lines += ['"IntervalTier"', f'"{name}"', "0", "2", str(size or len(spans))]
        lines += [f'{begin}\n{end}\n"{label}"' for begin, end, label in spans]
    return HEAD + "\n".join(lines) + "\n"


PHONES = [(0, 0.5, ""), (0.5, 0.6, "HH"), (0.6, 0.75, "AH0"), (0.75, 1.0, "L"), (1.0, 1.4, "OW1"), (1.4, 2.0, "")]


@pytest.mark.parametrize(
    ("content", "told"),
    [
        *((short_form(("phones", PHONES), size=size), "cut off or damaged") for size in (1, 2, 3, 4, 5, 7, 8, 9, 50)),
        (short_form(("phones", PHONES), ("words", PHONES), size=5), "cut off or damaged"),
        (short_form(("phones", PHONES), ("words", PHONES), size=7), "cut off or damaged"),
        *(
            (short_form(("words", PHONES), ("phones", PHONES)).replace("<exists>\n2", f"<exists>\n{count}"), "cut off")
            for count in (0, 1, 3)
        ),
        (short_form(("phones", [(0, 0.5, "HH"), (0.3, 1, "L"), (1, 2, "S")])), "intervals that overlap, at 'L'"),
        (short_form(("phones", [(0, 0.5, "HH"), (0.5, 0.4, "L"), (0.5, 2, "S")])), "go back, or intervals that"),
        (short_form(("phones", [(-1, 0, ""), (0, 1, "L")])), "from 0 s on"),
        (short_form(("phones", [(0, 0.5, "HH"), (0.5, 0.5, "L"), (0.5, 2, "S")])), "'L' at 0.5 s has no length"),
        (short_form(("phones", PHONES)).replace("\n2\n<exists>", "\n1\n<exists>"), "and its tier or file ends at 1 s"),
        (short_form(("phones", PHONES)).replace('"phones"\n0\n2', '"phones"\n0\n1.2'), "tier or file ends at 1.2 s"),
        (short_form(("phones", PHONES), ("phones", [(0, 2, "S")])), "two tiers named 'phones'; expected a name"),
        (short_form(("words", PHONES), ("words", PHONES)), "two tiers named 'words'"),
        ("ooBinaryFile\x08TextGrid\0\0", "Praat's binary form; expected text"),
        ('"Praat chronological TextGrid text file"\n0 2 ! Time domain.\n', "chronological form; expected text"),
        *(
            (short_form(("phones", [(0, 2, label)])), f"phoneme '{label}' of {which}; expected ARPAbet, as of MFA's")
            for label, which in (("ə", "the IPA"), ("ɹ", "the IPA"), ("tʃ", "the IPA"), ("ix", "TIMIT"),
                                 ("bcl", "TIMIT"), ("h#", "TIMIT"))
        ),
    ],
)  # fmt: skip
def test_textgrid__damaged_ambiguous_or_of_other_phones__is_refused_by_name(tmp_path, content, told):
    (tmp_path / "a.TextGrid").write_text(content)
    with pytest.raises(BadInput, match=told):
        read_textgrid(tmp_path / "a.TextGrid")
