"""One response and one record as instruments write them: read to the same numbers, or refused with what to write."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactuator.cli import main
from tactuator.errors import BadInput
from tactuator.io import text_table
from tactuator.io.display import parse_display
from tactuator.io.record import read_measured, read_record
from tactuator.io.response_table import ResponseColumns, read_response
from tactuator.signals.record import FrequencyResponse

HERTZ = np.geomspace(10.0, 1000.0, 40)
S = 2j * np.pi * HERTZ
VALUE = 0.02 * 1100.0**2 / (S**2 + 73.0 * S + 1100.0**2) * np.exp(-2e-3 * S)
DB, DEG = 20.0 * np.log10(np.abs(VALUE)), np.degrees(np.angle(VALUE))
TIME = np.arange(200) / 4000.0
COMMAND, POSITION = np.random.default_rng(7).standard_normal((2, 200))


def rows(*columns: np.ndarray, mark: str = ",", form: str = "{:.9g}", comma: bool = False, end: str = "\n") -> str:
    lines = (mark.join(form.format(value) for value in row) for row in zip(*columns, strict=True))
    text = end.join(lines) + end
    return text.replace(".", ",") if comma else text


@dataclass(frozen=True)
class Layout:
    """A text as an instrument writes it. words: of the refusal, None where it is read; columns: named by options; said:
    a remark.
    """

    name: str
    text: str
    ending: str = ".csv"
    columns: dict[str, Any] = field(default_factory=dict)
    words: str | None = None
    said: str = ""
    encoding: str = "utf-8"
    quantity: str | None = None

    def path(self, folder: Path) -> Path:
        path = folder / f"table{self.ending}"
        path.write_bytes(self.text.encode(self.encoding))
        return path


POLAR = "\n".join(f"{f:.14e}\t({a:.14e}dB,{p:.14e}\u00b0)" for f, a, p in zip(HERTZ, DB, DEG, strict=True))
PARTS = "\n".join(f"{f:.14e}\t{v.real:.14e},{v.imag:.14e}" for f, v in zip(HERTZ, VALUE, strict=True))
PYTHON = "\n".join(f"{f:.9g},{v.real:.9g}{v.imag:+.9g}j" for f, v in zip(HERTZ, VALUE, strict=True))
OCTAVE = "\n".join(f"{f:.9g} ({v.real:.9g},{v.imag:.9g})" for f, v in zip(HERTZ, VALUE, strict=True))
SIZE, RAD = np.abs(VALUE), np.angle(VALUE)
BOTH = rows(np.r_[HERTZ, HERTZ[::-1]], np.r_[DB, DB[::-1]], np.r_[DEG, DEG[::-1]])
FOUR = rows(HERTZ, *(part for _ in range(4) for part in (SIZE, DEG)), mark=" ")
ONE_OF_FOUR = {"magnitude": "S21 (magnitude)", "phase": "S21 (deg)"}

GERMAN = "Frequenz in Hz;Betrag in dB;Winkel in Grad\n" + rows(HERTZ, DB, DEG, mark=";", comma=True)

RESPONSES = [
    Layout("spreadsheet", "frequency_hz,magnitude_db,phase_deg\n" + rows(HERTZ, DB, DEG)),
    Layout(
        "unit in brackets", "f [Hz],Magnitude [dB],phase (deg)\n" + rows(HERTZ, DB, DEG), said="'phase (deg)' in deg"
    ),
    Layout("unit behind a stroke", "Frequency/Hz;Gain/dB;Phase/\u00b0\n" + rows(HERTZ, DB, DEG, mark=";", comma=True)),
    Layout(
        "room acoustics",
        "* Measurement data\n* Source: card 3\n*\n* Freq(Hz) SPL(dB) Phase(degrees)\n" + rows(HERTZ, DB, DEG, mark=" "),
        ".txt",
    ),
    Layout("loudspeaker frd", rows(HERTZ, DB, DEG, mark="   "), ".frd"),
    Layout("loudspeaker zma", "* impedance\n" + rows(HERTZ, SIZE, DEG, mark="\t"), ".zma", said="ohm"),
    Layout("circuit simulator, polar", f"Freq.\tV(pos)\n{POLAR}\n", ".txt", encoding="latin-1"),
    Layout("circuit simulator, cartesian", f"Freq.\tV(pos)\n{PARTS}\n", ".txt"),
    Layout(
        "frequency response analyser",
        "Bode\nDevice: 100\n\nFrequency (Hz);Trace 1: Gain: Magnitude (dB);"
        "Trace 1: Gain: Phase (\u00b0)\n" + rows(HERTZ, DB, DEG, mark=";", comma=True),
        encoding="utf-8-sig",
    ),
    Layout(
        "analyser with a head",
        "---Setup---\nStart Frequency (Hz): 10\nProbe CH1: 10:1\n---\nFrequency (Hz),TR1: Gain "
        "(Real),TR1: Gain (Imag),TR1: Gain (dB),TR2: Gain (Degree)\n" + rows(HERTZ, VALUE.real, VALUE.imag, DB, DEG),
    ),
    Layout(
        "network analyser",
        "!CSV A.01\n!Date: 2024\nBEGIN CH1_DATA\nFreq(Hz),S21(DB),S21(DEG)\n" + rows(HERTZ, DB, DEG) + "END\n",
        said="'END'",
    ),
    Layout(
        "network analyser, parts",
        "freq[Hz];re:Trc1_S21;im:Trc1_S21;\n" + rows(HERTZ, VALUE.real, VALUE.imag, mark=";", end=";\n"),
    ),
    Layout(
        "touchstone, one port", "! made by\n# Hz S RI R 50\n" + rows(HERTZ, VALUE.real, VALUE.imag, mark=" "), ".s1p"
    ),
    Layout("touchstone, kHz", "# kHz S DB R 50\n" + rows(HERTZ / 1e3, DB, DEG, mark=" ", end=" ! n\n"), ".s1p"),
    Layout(
        "touchstone, two ports", "# Hz S MA R 50\n" + FOUR, ".s2p", words="4 columns may be the phase: 'S11.*`phase`"
    ),
    Layout("touchstone, named", "# Hz S MA R 50\n" + FOUR, ".s2p", ONE_OF_FOUR, said="not read: 'S11"),
    Layout("no names", rows(HERTZ, DB, DEG, mark="\t"), ".txt", words="which column is which"),
    Layout(
        "no names, but options",
        rows(HERTZ, DB, DEG, mark="\t"),
        ".dat",
        {"frequency": "column1=Hz", "magnitude": "column2=dB", "phase": "column3=deg"},
    ),
    Layout(
        "laboratory program",
        "X_Value\tMagnitude (dB)\tPhase (deg)\n" + rows(HERTZ, DB, DEG, mark="\t", comma=True),
        ".lvm",
        words="no frequency among .*`frequency` NAME",
    ),
    Layout(
        "laboratory program, named",
        "X_Value\tMagnitude (dB)\tPhase (deg)\tComment\n" + rows(HERTZ, DB, DEG, mark="\t"),
        ".lvm",
        {"frequency": "X_Value"},
    ),
    Layout("complex in a script's words", f"f,H\n{PYTHON}\n"),
    Layout("complex in brackets", f"% f H\n{OCTAVE}\n", ".dat"),
    Layout("degrees without a unit", "Frequency,Magnitude,Phase\n" + rows(HERTZ, SIZE, DEG), said="no unit.*degrees"),
    Layout(
        "radians without a unit",
        "Frequency,Magnitude,Phase\n" + rows(HERTZ, SIZE, RAD),
        words="'Phase' has no unit and stays within .*`phase` 'Phase=deg' or `phase` 'Phase=rad'",
    ),
    Layout("radians, said", "Frequency,Magnitude,Phase\n" + rows(HERTZ, SIZE, RAD), columns={"phase": "Phase=rad"}),
    Layout("up and down", "frequency_hz,magnitude_db,phase_deg\n" + BOTH, said="40 of 40 frequencies come 2 times"),
    Layout("from 0 Hz", "frequency_hz,magnitude_db,phase_deg\n0,-3,0\n" + rows(HERTZ, DB, DEG), said="1 row of 0 Hz"),
    Layout(
        "coherence", "Freq,Gain dB,Phase deg,Coherence\n" + rows(HERTZ, DB, DEG, 0 * HERTZ + 0.99), said="coherence"
    ),
    Layout("angular frequency", "omega (rad/s),|H| (dB),arg(H) (rad)\n" + rows(2 * np.pi * HERTZ, DB, RAD)),
    Layout(
        "kilohertz",
        "frequency (kHz)\tgain\tphase (rad)\n" + rows(HERTZ / 1e3, SIZE, RAD, mark="\t"),
        ".tsv",
        encoding="utf-16",
    ),
    Layout("a row of units", "Frequency,Gain,Phase\nHz,dB,deg\n\n" + rows(HERTZ, DB, DEG)),
    Layout(
        "vibrometer",
        "Frequency [ Hz ]\tMagnitude [ (m/s)/V ]\tPhase [ \u00b0 ]\n" + rows(HERTZ, SIZE, DEG, mark="\t"),
        ".txt",
        said="response of velocity",
        quantity="velocity",
    ),
    Layout("German words", GERMAN, words="'in Grad' may be degrees or gradians; expected deg or gon"),
    Layout("German words, said", GERMAN, columns={"phase": "Winkel in Grad=deg"}),
    Layout(
        "a lag",
        "f (Hz),gain (dB),phase lag (deg)\n" + rows(HERTZ, DB, -DEG),
        words="beside what is not read: 'phase lag",
    ),
    Layout("percent", "f (Hz),gain (%),phase (deg)\n" + rows(HERTZ, 100 * SIZE, DEG), words="no magnitude among"),
    Layout(
        "phase by another name",
        "frequency_hz,magnitude_db,Gang\n" + rows(HERTZ, DB, DEG),
        words="not read: 'Gang'.*`phase` 'Gang' if it is the phase, or `ignore` 'Gang'",
    ),
    Layout(
        "phase with units in its cells",
        "frequency_hz,magnitude_db,phase_deg\n" + rows(HERTZ, DB, DEG, end="\u00b0\n"),
        words="phase is missing at 40 of 40",
    ),
    Layout(
        "two traces",
        "f (Hz),CH1 (dB),CH1 (deg),CH2 (dB),CH2 (deg)\n" + rows(HERTZ, 0 * DB, 0 * DEG, DB, DEG),
        words="2 columns may be the phase: 'CH1",
    ),
    Layout(
        "two traces, named",
        "f (Hz),CH1 (dB),CH1 (deg),CH2 (dB),CH2 (deg)\n" + rows(HERTZ, 0 * DB, 0 * DEG, DB, DEG),
        columns={"magnitude": "CH2 (dB)", "phase": "CH2 (deg)"},
        said="not read: 'CH1",
    ),
    Layout(
        "parts and levels that differ",
        "f (Hz),real,imag,gain (dB)\n" + rows(HERTZ, VALUE.real, VALUE.imag, DB + 6),
        words="'real', 'imag' and 'gain .dB.' say the response differently.*`real`",
    ),
    Layout(
        "thousands",
        "frequency_hz;magnitude_db;phase_deg\n" + rows(HERTZ, DB, DEG, mark=";", comma=True) + "1.234,5;-40,0;-90,0\n",
        words="'1.234,5' in row 41 of frequency_hz is no number",
    ),
    Layout(
        "a unit that contradicts",
        "a (s),b (dB),c (deg)\n" + rows(HERTZ, DB, DEG),
        columns={"frequency": "a (s)"},
        words="'a .s.', named as frequency, is in s",
    ),
    Layout(
        "angular without a unit", "omega,gain_db,phase_deg\n" + rows(HERTZ, DB, DEG), words="`frequency` 'omega=Hz' or"
    ),
    Layout("a multiple", "Frequency [krpm],gain,phase (deg)\n" + rows(HERTZ, SIZE, DEG), words="no unit that is known"),
    Layout("logarithms", "f [log10 Hz],gain,phase [deg]\n" + rows(HERTZ, SIZE, DEG), words="no frequency among"),
    Layout("power", "f (Hz),|H|^2,phase (deg)\n" + rows(HERTZ, SIZE**2, DEG), words="no magnitude among"),
    Layout("a factor", "f (Hz),gain x 1000,phase (deg)\n" + rows(HERTZ, 1e3 * SIZE, DEG), words="no magnitude among"),
    Layout("a divided unit", "f (Hz),gain [dB/2],phase (deg)\n" + rows(HERTZ, DB / 2, DEG), words="no magnitude among"),
    Layout(
        "a tenth of degrees", "f (Hz),gain,phase/10 deg\n" + rows(HERTZ, SIZE, DEG / 10), words="not read: 'phase/10"
    ),
    Layout(
        "an accelerometer", "f (Hz),acc [(m/s^2)/V],phase (deg)\n" + rows(HERTZ, SIZE, DEG), quantity="acceleration"
    ),
    Layout("units as names", "Hz,mm/V,\u00b0\n" + rows(HERTZ, SIZE, DEG), said="'mm/V' in mm"),
    Layout("dB20", "f (Hz),dB20(S21),deg(S21)\n" + rows(HERTZ, DB, DEG), said="in dB"),
    Layout("a share", "f (Hz),relative gain,phase (deg)\n" + rows(HERTZ, SIZE, DEG), words="no magnitude among"),
    Layout("a lead with a sign", "f (Hz),gain,-phase (deg)\n" + rows(HERTZ, SIZE, -DEG), words="not read: '-phase"),
    Layout(
        "thousandths", "f (Hz),gain,phase [mdeg]\n" + rows(HERTZ, SIZE, 1e3 * DEG), words="`phase` 'phase .mdeg.=deg'"
    ),
    Layout("two things in brackets", "f (Hz),gain (dB),phase (Degrees, wrapped)\n" + rows(HERTZ, DB, DEG)),
    Layout(
        "another unit than the name ends in",
        "f (Hz),gain (dB),arg_rad\n" + rows(HERTZ, DB, DEG),
        columns={"magnitude": "gain (dB)", "phase": "arg_rad=deg"},
    ),
    Layout("nepers", "f (Hz),gain [Np],phase [deg]\n" + rows(HERTZ, np.log(SIZE), DEG), said="'gain [Np]' in Np"),
    Layout("linear, of a capital", "f (Hz),Gain,phase [deg]\n" + rows(HERTZ, SIZE, DEG), said="'Gain' in linear units"),
    Layout(
        "coherence in percent",
        "freq,gain_db,phase_deg,coherence\n" + rows(HERTZ, DB, DEG, 0 * DB + 99.0),
        words="'coherence' goes from 99 to 99; expected 0 to 1",
    ),
]


@pytest.mark.parametrize("layout", RESPONSES, ids=lambda layout: layout.name)
def test_response__as_an_instrument_writes_it__is_read_or_refused_with_what_to_write(tmp_path, layout: Layout) -> None:
    columns = ResponseColumns(**layout.columns)
    if layout.words is not None:
        with pytest.raises(BadInput, match=layout.words) as refusal:
            read_measured(layout.path(tmp_path), columns)
        assert "\n" not in str(refusal.value)
        return
    read = read_measured(layout.path(tmp_path), columns)
    assert isinstance(read, FrequencyResponse)
    np.testing.assert_allclose(read.frequency_hz, HERTZ, rtol=1e-6)
    np.testing.assert_allclose(read.value(), VALUE, rtol=2e-6)
    assert any(layout.said.split(".*")[0] in remark for remark in read.remarks)
    assert read.about.get("quantity") == layout.quantity


PLAIN = rows(TIME, COMMAND, POSITION)


def record_rows(**more: Any) -> str:
    return rows(TIME, COMMAND, POSITION, **more)


SWAPPED = rows(TIME, POSITION, COMMAND)
LABVIEW = (
    "LabVIEW Measurement\t\nX_Columns\tNo\n***End_of_Header***\t\nChannels\t2\t\nSamples\t200\t200\n"
    "Date\t2024/05/01\t2024/05/01\nTime\t12:00:00.5\t12:00:00.5\nX0\t0\t0\nDelta_X\t0.00025\t0.00025\n"
    "***End_of_Header***\t\nX_Value\tCommand\tPosition\tComment\n"
)
RECORDS = [
    Layout("spreadsheet", "time_s,command_v,position_v\n" + PLAIN),
    Layout(
        "spreadsheet, decimal commas",
        "Zeit;Eingang;Weg\n" + record_rows(mark=";", comma=True),
        columns={"time": "Zeit", "input": "Eingang=V", "output": "Weg=mm"},
    ),
    Layout(
        "laboratory program",
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\n***End_of_Header***\t\n\t\n"
        "Channels\t2\nSamples\t200\t200\nX0\t0,0\t0,0\n***End_of_Header***\t\nX_Value\tCommand\tPosition\tComment\n"
        + record_rows(mark="\t", comma=True),
        ".lvm",
    ),
    Layout(
        "oscilloscope, units below", "Time,Channel A,Channel B\n(ms),(V),(mV)\n\n" + rows(TIME * 1e3, COMMAND, POSITION)
    ),
    Layout("oscilloscope, units alone", "Model,X\nRecord Length,200\nSecond,Volt,Volt\n" + PLAIN),
    Layout("oscilloscope, numbered", "x-axis,1,2\nsecond,Volt,Volt\n" + record_rows(form="{:+.9E}")),
    Layout("oscilloscope, spare comma", "Model,MSO\nFirmware,1.2\n\nTIME,CH1,CH2\n" + record_rows(end=",\n")),
    Layout("circuit simulator", "time\tV(cmd)\tV(pos)\n" + record_rows(mark="\t"), ".txt"),
    Layout(
        "a time beside each", "X_Value\tCmd (V)\tX_Value\tPos (V)\n" + rows(TIME, COMMAND, TIME, POSITION, mark="\t")
    ),
    Layout("logic analyser", "Time [s],Channel 0,Channel 1\n" + PLAIN),
    Layout("names in a remark", "# bench of Monday\n# time,u,y\n" + PLAIN),
    Layout("semicolons before remarks", "; a rig\n; t u y\n" + record_rows(mark=" "), ".log"),
    Layout("aligned with blanks", "   t      u     y\n" + record_rows(mark="   ", form="{:14.8f}"), ".prn"),
    Layout("an empty first cell", "time;command;position;\n" + record_rows(mark=";", end=";\n")),
    Layout("names in quotes", '"time_s","command_v","position_v"\r\n' + record_rows(end="\r\n")),
    Layout(
        "stamps with a date",
        "stamp,command,position\n"
        + "".join(
            f"2024-05-01T12:00:00.{round(t * 1e6):06d},{u:.9g},{y:.9g}\n"
            for t, u, y in zip(TIME, COMMAND, POSITION, strict=True)
        ),
        columns={"time": "stamp"},
    ),
    Layout(
        "a second position",
        "t,command_v,position_v,position2_v\n" + rows(TIME, COMMAND, POSITION, POSITION[::-1]),
        said="not read: 'position2_v'",
    ),
    Layout(
        "velocity",
        "time_s,command_v,velocity_mm_s\n" + PLAIN,
        quantity="velocity",
        said="'velocity_mm_s' is read as velocity",
    ),
    Layout(
        "accelerometer", "time_s,current_A,acc (g)\n" + PLAIN, quantity="acceleration", said="is read as acceleration"
    ),
    Layout("current", "time_s,current_A,position_v\n" + PLAIN, said="'current_A' is read in A, where"),
    Layout("position first, by unit", "time,laser (mm),amp (V)\n" + SWAPPED, said="'amp (V)' is read as the command"),
    Layout("position first, by name", "time,encoder,motor\n" + SWAPPED, said="'motor' is read as the command"),
    Layout("position first, by letter", "time,y1,u1\n" + SWAPPED, said="'u1' is read as the command"),
    Layout("by their order", "time,a,b\n" + PLAIN, said="'a' is read as the command, 'b' as the position"),
    Layout(
        "an unknown unit", "time,command,position [inch]\n" + PLAIN, said="'position [inch]' has no unit that is known"
    ),
    Layout(
        "time in tenths", "Time [0.1 ms],u,y\n" + rows(1e4 * TIME, COMMAND, POSITION), words="`time` NAME or NAME=UNIT"
    ),
    Layout(
        "a step in the head",
        LABVIEW + "".join(f"\t{u:.9g}\t{y:.9g}\n" for u, y in zip(COMMAND, POSITION, strict=True)),
        ".lvm",
        said="head, 4000 Hz",
    ),
    Layout("a rate in the head", "# Sample rate: 4 kHz\nu,y\n" + rows(COMMAND, POSITION), said="head, 4000 Hz"),
    Layout("two rates", "Rate: 8 kHz\nDecimated rate: 4 kHz\nu,y\n" + rows(COMMAND, POSITION), words="`rate_hz`"),
    Layout("grams", "time_s,command_v,load (g)\n" + PLAIN, words="may be in grams.*=g'"),
    Layout(
        "a unit that contradicts",
        "clock (V),u,y\n" + PLAIN,
        columns={"time": "clock (V)"},
        words="'clock .V.', named as time, is in V",
    ),
    Layout(
        "another unit than the name is",
        "clock,amp,stage\n" + PLAIN,
        columns={"time": "clock=s", "input": "amp=V", "output": "stage=mm"},
        said="'amp' is read in V, as stated, not in A",
    ),
    Layout(
        "another unit than in brackets",
        "time,amp [m],stage\n" + PLAIN,
        columns={"input": "stage=V", "output": "amp [m]=mm"},
        words="'amp .m.' is in m by its name and in mm otherwise",
    ),
    Layout(
        "another quantity than the name",
        "time,u,position\n" + PLAIN,
        columns={"output": "position=mm/s"},
        quantity="velocity",
    ),
    Layout("four columns", "a,b,c,d\n" + rows(TIME, COMMAND, POSITION, COMMAND), words="which column is which"),
    Layout("names for fewer", "time,u\n" + PLAIN, words="2 names over 3 columns"),
    Layout("a row cut short", "t,u,y\n1,2\n" + PLAIN, words="row 1 has 2 of 3 columns"),
    Layout("no numbers", "a letter\nto somebody, of words\n", ".txt", words="no rows of numbers"),
]


@pytest.mark.parametrize("layout", RECORDS, ids=lambda layout: layout.name)
def test_record__as_an_instrument_writes_it__is_read_or_refused_with_what_to_write(tmp_path, layout: Layout) -> None:
    if layout.words is not None:
        with pytest.raises(BadInput, match=layout.words) as refusal:
            read_record(layout.path(tmp_path), **layout.columns)
        assert "\n" not in str(refusal.value)
        return
    read = read_record(layout.path(tmp_path), **layout.columns)
    np.testing.assert_allclose((read.command, read.position), (COMMAND, POSITION), atol=2e-8)
    assert read.rate_hz == pytest.approx(4000.0, rel=1e-4)
    assert any(layout.said in remark for remark in read.remarks) or not layout.said
    assert read.about.get("quantity") == layout.quantity


def test_units__of_a_record__are_taken_from_names_rows_and_options(tmp_path: Path) -> None:
    units = {layout.name: layout for layout in RECORDS}
    for name, expected in {
        "spreadsheet, decimal commas": ("V", "mm"),
        "oscilloscope, units below": ("V", "mV"),
        "accelerometer": ("A", "g"),
        "velocity": ("V", "mm/s"),
    }.items():
        layout = units[name]
        read = read_record(layout.path(tmp_path), **layout.columns)
        assert (read.command_unit, read.position_unit) == expected


@pytest.mark.parametrize("command", ["torque_nm", "Torque (nm)", "motor_moment_nm"])
def test_units__torque_in_small_letters__is_in_newton_metres(tmp_path: Path, command: str) -> None:
    path = tmp_path / "torque.csv"
    rows = "".join(f"{k / 1000},{k % 7},{k % 5}\n" for k in range(200))
    path.write_text(f"time_s,{command},position_nm\n{rows}")
    read = read_record(path, input=command, output="position_nm")
    assert (read.command_unit, read.position_unit) == ("Nm", "nm")


def test_table__over_2_gib__is_refused_unread(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "r.csv"
    with path.open("wb") as file:
        file.truncate((2 << 30) + 1)
    monkeypatch.setattr(text_table, "_first_lines", lambda _: pytest.fail("it is read"))
    with pytest.raises(BadInput, match=r"it has 2\.0 GiB; expected up to 2 GiB"):
        read_record(path)


def test_repeated_frequencies__apart__are_averaged_with_an_error_that_holds_them(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("frequency_hz,magnitude_db\n" + rows(np.r_[HERTZ, HERTZ], np.r_[DB, DB + 2.0]))
    read = read_response(path)
    np.testing.assert_allclose(20.0 * np.log10(read.magnitude), DB + 1.0, atol=1e-6)
    np.testing.assert_allclose(read.deviation, np.log(10.0) / 20.0, rtol=1e-6)
    path.write_text(
        "frequency_hz,magnitude,phase_deg\n" + rows(np.r_[HERTZ, HERTZ], np.r_[SIZE, SIZE], np.r_[DEG, DEG + 60])
    )
    read = read_response(path)
    np.testing.assert_allclose(read.value(), VALUE * np.exp(1j * np.pi / 6.0) * np.cos(np.pi / 6.0), rtol=1e-6)


@pytest.mark.parametrize(
    "name", ["unit in brackets", "room acoustics", "circuit simulator, polar", "analyser with a head"]
)
def test_identify__layouts_of_a_response_with_dead_time__find_it(tmp_path: Path, capsys, name: str) -> None:
    layout = next(each for each in RESPONSES if each.name == name)
    assert main(["identify", str(layout.path(tmp_path)), "--order", "2", "--zeros", "0", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["model"]["delay_s"] == pytest.approx(2e-3, abs=1e-6)
    assert found["poles_hz"] == pytest.approx([1100.0 / (2.0 * np.pi)] * 2, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--phase", "phase"], "no phase column 'phase'; expected a (Hz), b (dB), lag"),
        (["--phase", "lag=m"], "'lag', named as phase, is in m; expected a column for --phase in another unit"),
        (["--phase", "lag=turns of 9"], "the unit 'turns of 9' of 'lag'; expected Hz, s, deg, rad"),
        (["--magnitude", "lag=dB"], "not read: 'b (dB)'; expected --phase 'b (dB)' if it is the phase, or --ignore"),
        (["--ignore", "x"], "no column to ignore 'x'; expected a (Hz), b (dB), lag"),
        ([], "a magnitude without phase, beside what is not read: 'lag'"),
    ],
)
def test_identify__columns_amiss__end_with_2_and_write_nothing(tmp_path: Path, capsys, options, words: str) -> None:
    path, out = tmp_path / "r.csv", tmp_path / "model.json"
    path.write_text("a (Hz),b (dB),lag\n" + rows(HERTZ, DB, DEG))
    assert main(["identify", str(path), *options, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not out.exists()


def test_identify__quantity_that_the_unit_contradicts__is_refused(tmp_path: Path, capsys) -> None:
    path = tmp_path / "r.csv"
    path.write_text("t,u,position_mm\n" + PLAIN)
    assert main(["identify", str(path), "--quantity", "velocity"]) == 2
    assert "quantity is 'velocity', while the position is in mm; it must be 'displacement'" in capsys.readouterr().err


def test_display__names_the_columns_of_a_response_or_is_refused_with_what_to_write(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(GERMAN, encoding="utf-8")
    entry = {"name": "x", "sensor_gain_v_per_mm": 2.0, "travel_mm": 4.0, "structure": "none"}
    document: dict[str, Any] = {"display": {"rate_hz": 8000.0}, "threshold": {"band_hz": [12.0, 300.0]}}

    def channel(plant: Any) -> Any:
        return parse_display({**document, "channel": [{**entry, "plant": plant}]}, beside=tmp_path).channels[0]

    named = channel({"file": "r.csv", "phase": "Winkel in Grad=deg"})
    far = (HERTZ < 100.0) | (HERTZ > 300.0)  # from the resonance, which has few points
    np.testing.assert_allclose(np.abs(named.plant.response(HERTZ[far])), SIZE[far], rtol=0.05)
    with pytest.raises(BadInput, match=r"may be degrees or gradians.*plant = \{ file = "):
        channel("r.csv")
    for table, words in (({"file": "r.csv", "phse": "x"}, "did you mean 'phase'"), ({"phase": "x"}, "not a known key")):
        with pytest.raises(BadInput, match=words):
            channel(table)


MARKS = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": " ", "blanks": "   "}
SPELT: dict[str, Callable[[str, str], str]] = {
    "brackets": "{0} [{1}]".format, "parentheses": "{0}({1})".format, "underscore": "{0}_{1}".format,
    "stroke": "{0}/{1}".format, "row": lambda name, _: name,
}  # fmt: skip


@given(data=st.data())
def test_response__in_a_drawn_layout__has_its_numbers_or_is_refused(tmp_path_factory, data) -> None:
    draw = data.draw
    form, angle = draw(st.sampled_from(["dB", "linear", "parts"])), draw(st.sampled_from(["deg", "rad"]))
    hertz = draw(st.sampled_from(["Hz", "kHz", "none"]))
    columns = [
        (
            "frequency" if hertz != "none" else "f",
            "" if hertz == "none" else hertz,
            HERTZ / (1e3 if hertz == "kHz" else 1),
        )
    ]
    if form == "parts":
        columns += [("real", "", VALUE.real), ("imag", "", VALUE.imag)]
    else:
        columns += [("gain", "dB", DB) if form == "dB" else ("gain", "", SIZE)]
        columns += [
            (
                draw(st.sampled_from(["phase", "ang", "lag"])),
                draw(st.sampled_from([angle, ""])),
                DEG if angle == "deg" else RAD,
            )
        ]
    columns += draw(st.sampled_from([[], [("noise", "V", SIZE)], [("point", "", np.arange(40.0))]]))
    columns = draw(st.permutations(columns))
    name, spelt = draw(st.sampled_from(sorted(MARKS))), draw(st.sampled_from(sorted(SPELT)))
    mark, comma = MARKS[name], name != "comma" and draw(st.booleans())
    heads = [SPELT[spelt](column, unit) if unit else column for column, unit, _ in columns]
    lines = [mark.join(heads)]
    if spelt == "row":
        lines.append(mark.join(unit or "-" for _, unit, _ in columns))
    lines = (
        draw(st.lists(st.sampled_from(["Instrument 7", "# made 2024", "* * *", "", "Points: 40"]), max_size=4)) + lines
    )
    end = draw(st.sampled_from(["\n", "\r\n"]))
    body = rows(
        *(values for _, _, values in columns),
        mark=mark,
        form=draw(st.sampled_from(["{:.9g}", "{:.9e}"])),
        comma=comma,
        end=end,
    )
    path = tmp_path_factory.getbasetemp() / "drawn.txt"
    path.write_bytes((end.join(lines) + end + body).encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]))))
    try:
        read = read_measured(path)
    except BadInput:
        return
    assert isinstance(read, FrequencyResponse)
    np.testing.assert_allclose(read.frequency_hz, HERTZ, rtol=1e-6)
    np.testing.assert_allclose(read.magnitude, SIZE, rtol=1e-6)
    assert read.phase_rad is not None
    np.testing.assert_allclose(read.value(), VALUE, rtol=1e-5)
