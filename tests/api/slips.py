"""Setups of several actuators and the files that a person would write of them, right or with one slip.

Nothing of the project is used: plants are stepped by SciPy, files are text. A setup is the truth; `Written` is what the
files say of it, as factors, so that a slip of units is one number.
"""

from __future__ import annotations

import contextlib
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal

from tactuator.cli.main import main as tactuator

LIBRARY_UM = ((0.4, 31.0), (3.0, 30.0), (10.0, 9.0), (30.0, 3.5), (100.0, 0.5), (250.0, 0.12), (300.0, 0.14))
"""Thresholds of about everybody, micrometres of peak displacement, at hertz."""


@dataclass(frozen=True)
class Setup:
    """An actuator: volts of the sensor over volts of command num/den, what its sensor, travel and converter are."""

    name: str
    num: tuple[float, ...]
    den: tuple[float, ...]
    gain_v_per_mm: float
    travel_mm: float
    range_v: float
    rate_hz: float
    band_hz: tuple[float, float]
    structure: str
    quantity: str = "displacement"
    drive_v: float = 1.0
    load: tuple[float, float, float] | None = None

    def response(self, hertz: np.ndarray) -> np.ndarray:
        """Return the complex response at hertz, (n,)."""
        return np.asarray(signal.freqs(self.num, self.den, 2.0 * np.pi * hertz)[1])


def resonator(name: str, hertz: float, q: float, at_rest: float, **more: Any) -> Setup:
    """Return a setup of one resonance: volts of the sensor per volt at rest, or of the quantity at high frequency."""
    w = 2.0 * math.pi * hertz
    num = (at_rest, 0.0, 0.0) if more.get("quantity") == "acceleration" else (at_rest * w * w,)
    return Setup(name, num, (1.0, w / q, w * w), **more)


MOTOR = Setup("motor", (2875.0,), (1.0, 94.0, 290.0), 0.199, 12.5, 10.0, 4000.0, (0.4, 300.0), "paper",
              drive_v=1.5, load=(0.12, 31.0, 360.0))  # fmt: skip
COIL = resonator("voice coil", 30.0, 1.67, 1.0, gain_v_per_mm=2.0, travel_mm=4.0, range_v=10.0, rate_hz=8000.0,
                 band_hz=(2.0, 300.0), structure="none", drive_v=3.0)  # fmt: skip
PIEZO = resonator("piezo, 100 µm", 400.0, 10.0, 0.5, gain_v_per_mm=50.0, travel_mm=0.1, range_v=10.0, rate_hz=8000.0,
                  band_hz=(5.0, 300.0), structure="none", drive_v=2.0)  # fmt: skip
LRA = resonator("LRA, m/s²", 175.0, 10.0, 0.3, gain_v_per_mm=0.00002, travel_mm=0.5, range_v=3.0, rate_hz=8000.0,
                band_hz=(60.0, 300.0), structure="none", quantity="acceleration", drive_v=0.5)  # fmt: skip
EXCITER = resonator("exciter", 60.0, 2.0, 0.6, gain_v_per_mm=5.0, travel_mm=1.0, range_v=5.0, rate_hz=8000.0,
                    band_hz=(10.0, 300.0), structure="none", drive_v=1.0)  # fmt: skip
METRES = resonator("metres per volt", 30.0, 1.67, 1.0e-3, gain_v_per_mm=1e-3, travel_mm=10.0, range_v=10.0,
                   rate_hz=8000.0, band_hz=(2.0, 300.0), structure="none", drive_v=3.0)  # fmt: skip
MICROMETRES = resonator("micrometres per volt", 400.0, 10.0, 10.0, gain_v_per_mm=1e3, travel_mm=0.1, range_v=10.0,
                        rate_hz=8000.0, band_hz=(5.0, 300.0), structure="none", drive_v=2.0)  # fmt: skip
BIG_PIEZO = resonator("piezo on 150 V", 600.0, 20.0, 0.04, gain_v_per_mm=100.0, travel_mm=0.06, range_v=150.0,
                      rate_hz=16000.0, band_hz=(10.0, 300.0), structure="none", drive_v=40.0)  # fmt: skip
PIN = resonator("pin array", 80.0, 1.0, 0.2, gain_v_per_mm=4.0, travel_mm=0.5, range_v=10.0, rate_hz=2000.0,
                band_hz=(1.0, 60.0), structure="none", drive_v=3.0)  # fmt: skip
GAMEPAD = resonator("gamepad", 65.0, 5.0, 0.3, gain_v_per_mm=1.0, travel_mm=0.5, range_v=1.0, rate_hz=48000.0,
                    band_hz=(40.0, 300.0), structure="none", drive_v=0.2)  # fmt: skip
SETUPS = (MOTOR, COIL, PIEZO, LRA, EXCITER, METRES, MICROMETRES, BIG_PIEZO, PIN, GAMEPAD)


@dataclass(frozen=True)
class Written:
    """What files say of a setup: factors on what is true, 1 where it is right.

    plant: "record" (identified first), "inline" or "response". response: units of frequency, magnitude and phase under
    columns that promise frequency_hz, magnitude_db, phase_deg. level: how the curve's micrometres are written, "" for
    the library's own curve. keys: further lines of the channel.
    """

    plant: str = "inline"
    time: float = 1.0
    time_name: str = "time_s"
    command: float = 1.0
    position: float = 1.0
    position_name: str = "position_v"
    swapped: bool = False
    turned: bool = False
    gain: float = 1.0
    travel: float = 1.0
    range: float = 1.0
    rate: float = 1.0
    band: float = 1.0
    num: float = 1.0
    mass: float = 1.0
    response: tuple[str, str, str] = ("Hz", "dB", "deg")
    phased: bool = True
    level: str = ""
    pairs: tuple[float, float] | None = None
    environment: dict[str, Any] = field(default_factory=dict)

    def files(self, setup: Setup, folder: Path) -> None:
        """Write the files of a setup into the folder."""
        (folder / "display.toml").write_text(self._display(setup), encoding="utf-8")
        if self.plant == "record":
            self._record(setup, folder / "record.csv")
        if self.plant == "response":
            self._response(setup, folder / "response.csv")
        if self.level:
            moved_db = {"dB": 0.0, "mm": -60.0, "nm": 60.0}.get(self.level)
            levels = [um if moved_db is None else 20.0 * math.log10(um) + moved_db for _, um in LIBRARY_UM]
            rows = [f"{hertz:g},{level:.4g}" for (hertz, _), level in zip(LIBRARY_UM, levels, strict=True)]
            (folder / "own.csv").write_text("\n".join(["frequency_hz,level_db_re_1um", *rows]) + "\n")
        if self.pairs is not None:
            places = np.linspace(-0.9, 0.9, 9) * setup.travel_mm
            rows = [f"{self.pairs[0] * x:.6g},{self.pairs[1] * x * setup.gain_v_per_mm:.6g}" for x in places]
            (folder / "pairs.csv").write_text("\n".join(["displacement_mm,voltage_v", *rows]) + "\n")

    def _display(self, setup: Setup) -> str:
        name = {"record": "model.json", "response": "response.csv"}.get(self.plant)
        num = [self.num * value for value in setup.num]
        plant = f'"{name}"' if name else f"{{ num = {num}, den = {list(setup.den)} }}"
        low, high = (self.band * edge for edge in setup.band_hz)
        curve = '"own.csv"' if self.level else '"bolanowski-1988"'
        environment = {
            "noise_v_rms": 1e-4 * min(1.0, setup.range_v),
            "friction_v": 0.0,
            "hum_hz": [60.0],
            "hum_v_peak": [1e-5],
            **self.environment,
        }
        lines = [
            "[display]", f"rate_hz = {self.rate * setup.rate_hz}", "delay_samples = 1",
            "[converter]", f"range_v = {self.range * setup.range_v}",
            "[threshold]", f"curve = {curve}", f"band_hz = [{low}, {high}]",
            "[feedback]", f'structure = "{setup.structure}"', "[prefilter]", "poles = 6",
            "[environment]", *(f"{key} = {value}" for key, value in environment.items()),
            "[objectives]", "flatness_db = 3.0",
            "[[channel]]", 'name = "index"', f"sensor_gain_v_per_mm = {self.gain * setup.gain_v_per_mm}",
            f"travel_mm = {self.travel * setup.travel_mm}", f'quantity = "{setup.quantity}"', f"plant = {plant}",
        ]  # fmt: skip
        if setup.load is not None:
            mass, damping, stiffness = (self.mass * value for value in setup.load)
            lines.append(
                f'loads = [{{ name = "finger", mass = {mass}, damping = {damping}, stiffness = {stiffness} }}]'
            )
        return "\n".join(lines) + "\n"

    def _record(self, setup: Setup, path: Path) -> None:
        rng = np.random.default_rng(7)
        count, rate = 8000, min(setup.rate_hz, 8000.0)
        if setup is MOTOR:
            count, rate = 16000, 2000.0
        command = setup.drive_v * signal.lfilter([0.35], [1.0, -0.65], rng.standard_normal(count)).clip(-2.5, 2.5)
        num, den, _ = signal.cont2discrete((setup.num, setup.den), 1.0 / rate)
        position = signal.lfilter(np.ravel(num), den, command)
        position = position + 1e-3 * float(np.std(position)) * rng.standard_normal(count)
        position = -position if self.turned else position
        names = ["command_v", self.position_name]
        signals = [self.command * command, self.position * position]
        if self.swapped:
            signals.reverse()
        table = np.column_stack([self.time * np.arange(count) / rate, *signals])
        np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join([self.time_name, *names]), comments="")

    def _response(self, setup: Setup, path: Path) -> None:
        hertz = np.geomspace(0.7 * setup.band_hz[0], 2.0 * setup.band_hz[1], 60)
        hertz[[0, -1]] = float(f"{hertz[0]:.1e}"), float(f"{hertz[-1]:.1e}")
        value = setup.response(hertz) * np.exp(-2j * np.pi * hertz * 1e-4)
        value = value * (1.0 + 0.003 * np.random.default_rng(3).standard_normal(hertz.size))
        phase = np.unwrap(np.angle(value))
        unit, size, angle = self.response
        columns = {
            "frequency_hz": hertz * {"Hz": 1.0, "kHz": 1e-3, "rad/s": 2.0 * np.pi, "mHz": 1e3}[unit],
            "magnitude" if size in ("linear", "dB as linear") else "magnitude_db":
                np.abs(value) if size in ("linear", "linear as dB") else 20.0 * np.log10(np.abs(value)),
        }  # fmt: skip
        if self.phased:
            name = "phase_rad" if angle in ("rad", "deg as rad") else "phase_deg"
            turned = {"lag": -np.degrees(phase), "deg": np.degrees(phase), "deg as rad": np.degrees(phase)}
            columns[name] = turned.get(angle, phase)
        np.savetxt(
            path,
            np.column_stack(list(columns.values())),
            fmt="%.7g",
            delimiter=",",
            header=",".join(columns),
            comments="",
        )


@dataclass(frozen=True)
class Slip:
    """One slip of one setup. words: what some verb has to say of it; "" where nobody can tell and a verb says that."""

    name: str
    setup: Setup
    written: Written
    words: str = ""


def _record(name: str, words: str, setup: Setup = MOTOR, **more: Any) -> Slip:
    return Slip(name, setup, Written(plant="record", **more), words)


def _inline(name: str, words: str, setup: Setup = MOTOR, **more: Any) -> Slip:
    return Slip(name, setup, Written(**more), words)


def _response(name: str, words: str, setup: Setup = COIL, **more: Any) -> Slip:
    return Slip(name, setup, Written(plant="response", **more), words)


SLIPS = (
    _record("position in mV", "millivolts", position=1e3),
    _record("position in mV, piezo", "millivolts", PIEZO, position=1e3),
    _record("position in m", "metres", position=1e-3),
    _record("position in m, voice coil", "metres", COIL, position=0.5e-3),
    _record("position in counts", "counts", position=3276.8),
    _record("command in mV", "millivolts", command=1e3),
    _record("command in kV", "kilovolts", command=1e-3),
    _record("command in counts", "counts", COIL, command=3276.8),
    _record("time in ms, read as s", "milliseconds", time=1e3),
    _record("time in s, read as ms", "seconds", time_name="time_ms"),
    _record("time in µs, read as s", "milliseconds", COIL, time=1e6),
    _record("columns swapped, motor", "swapped", swapped=True),
    _record("columns swapped, voice coil", "swapped", COIL, swapped=True),
    _record("columns swapped, piezo", "swapped", PIEZO, swapped=True),
    _record("columns swapped, LRA", "swapped", LRA, swapped=True),
    _record("polarity", "negative static gain, a polarity", turned=True),
    _record("travel in m, with a record", "metres", travel=1e-3),
    _record("range in mV, with a record", "range_v in millivolts", range=1e3),
    _inline("travel in m", "metres", travel=1e-3),
    _inline("travel in µm", "sensor_gain_v_per_mm", travel=1e3),
    _inline("travel in µm, no loop", "micrometres", COIL, travel=1e3),
    _inline("travel in m, LRA", "metres", LRA, travel=1e-3),
    _inline("gain per metre", "sensor_gain_v_per_mm", gain=1e3),
    _inline("gain per metre, no loop", "per metre", EXCITER, gain=1e3),
    _inline("0.0004 V/mm", "micrometre", gain=0.002),
    _inline("gain per µm, piezo", "micrometre", PIEZO, gain=1e-3),
    _inline("gain per m/s² read as per mm/s²", "per metre", LRA, gain=1e3),
    _inline("plant in mV/V", "millivolts per volt", num=1e3),
    _inline("plant in m/V", "m per volt", num=1e-3),
    _inline("range in mV", "millivolts", range=1e3),
    _inline("range in kV", "kilovolts", EXCITER, range=1e-3),
    _inline("rate in kHz", "rate_hz", rate=1e-3),
    _inline("band in kHz", "band", band=1e-3),
    _inline("band in rad/s", "band", COIL, band=2.0 * math.pi),
    _inline("noise in mV", "millivolts", environment={"noise_v_rms": 0.2}),
    _inline("hum in mV", "millivolts", environment={"hum_v_peak": [1.0]}),
    _inline("friction in mV", "millivolts", environment={"friction_v": 4.0}),
    _inline("finger in grams", "grams", mass=1e3),
    _inline("curve in µm", "micrometres", level="µm"),
    _inline("curve in dB re 1 mm", "1 mm", level="mm"),
    _inline("curve in dB re 1 nm", "a curve in other units", level="nm"),
    _response("frequencies in kHz", "kilohertz", response=("kHz", "dB", "deg")),
    _response("frequencies in rad/s", "rad/s", response=("rad/s", "dB", "deg")),
    _response("linear in a column of dB", "linear", response=("Hz", "linear as dB", "deg")),
    _response("dB in a linear column", "dB", response=("Hz", "dB as linear", "deg")),
    _response("radians in a column of degrees", "radians", response=("Hz", "dB", "rad as deg")),
    _response("degrees in a column of radians", "degrees", response=("Hz", "dB", "deg as rad")),
    _response("lag without its sign", "sign", response=("Hz", "dB", "lag")),
    Slip("calibration in µm", MOTOR, Written(pairs=(1e3, 1.0)), "micrometres"),
    Slip("calibration in m", MOTOR, Written(pairs=(1e-3, 1.0)), "sensor_gain_v_per_mm"),
    Slip("calibration in mV", COIL, Written(pairs=(1.0, 1e3)), "millivolts"),
)  # fmt: skip

RIGHT = (
    *(Slip(f"{setup.name}: inline", setup, Written()) for setup in SETUPS),
    *(Slip(f"{setup.name}: record", setup, Written(plant="record", position_name=unit))
      for setup, unit in ((MOTOR, "position_v"), (COIL, "position_v"), (PIEZO, "position_v"), (LRA, "position_v"),
                          (EXCITER, "position_v"), (METRES, "position_m"), (MICROMETRES, "position_um"),
                          (BIG_PIEZO, "position_v"), (PIN, "position_v"), (GAMEPAD, "position_v"))),
    *(Slip(f"{setup.name}: response, {'/'.join(units)}", setup, Written(plant="response", response=units))
      for setup in (COIL, PIEZO, EXCITER, GAMEPAD) for units in (("Hz", "dB", "deg"), ("Hz", "linear", "rad"))),
    *(Slip(f"{setup.name}: response without phase", setup, Written(plant="response", phased=False))
      for setup in (COIL, PIEZO, EXCITER, PIN)),
    *(Slip(f"{setup.name}: own curve, pairs", setup, Written(level="dB", pairs=(1.0, 1.0)))
      for setup in (MOTOR, COIL, PIEZO, EXCITER, BIG_PIEZO, PIN)),
    *(Slip(f"{name}, {setup.name}", setup, written) for name, setup, written in (
        ("twice the rate", MOTOR, Written(plant="record", rate=2.0)),
        ("a tenth of the travel", COIL, Written(travel=0.1)),
        ("noise of 2 mV", MOTOR, Written(environment={"noise_v_rms": 2e-3})),
        ("friction of a tenth", COIL, Written(environment={"friction_v": 1.0})),
        ("a heavy finger", MOTOR, Written(mass=3.0)),
        ("a weak drive", MOTOR, Written(plant="record", command=1.0, range=4.0)),
    )),
)  # fmt: skip


@dataclass(frozen=True)
class Said:
    """One verb's exit status and all that it wrote."""

    verb: str
    status: int
    text: str

    @property
    def is_met(self) -> bool:
        """Tell whether its verdict is that everything is met."""
        return bool(re.search(r"^verdict: met", self.text, re.MULTILINE))

    @property
    def doubts(self) -> bool:
        """Tell whether it doubts the numbers of its files."""
        return bool(
            re.search(r"(met|judged), numbers: |note: .*expected|not to be trusted|another reading|swapped", self.text)
        )


def said_of(slip: Slip, folder: Path, measured: bool = False) -> Iterator[Said]:
    """Yield what each verb of the chain says of the files, as far as the chain comes; measured: at a rig, too."""
    setup, written = slip.setup, slip.written
    written.files(setup, folder)
    display, model, controller = (str(folder / name) for name in ("display.toml", "model.json", "controller.json"))
    if written.pairs is not None:
        pairs = _run("calibrate", str(folder / "pairs.csv"))
        yield pairs
        gain = re.search(r"gain: ([\d.e+-]+) ", pairs.text)
        if gain is not None:
            written = replace(written, gain=float(gain[1]) / setup.gain_v_per_mm)
            written.files(setup, folder)
    if written.plant != "inline":
        source = str(folder / f"{written.plant}.csv")
        order = ["--order", "2", "--no-friction"] if written.plant == "record" else []
        quantity = ["--quantity", setup.quantity]
        yield _run("identify", source, *order, *quantity, "--out", model)
    if written.plant == "record" and not Path(model).exists():
        return
    yield _run("design", display, "--out", controller)
    if Path(controller).exists():
        yield _run("check", controller)
        if measured:
            points = ["--frequency-hz", "40,100", "--level", "5", "--confidence-db", "1"]
            yield _run("measure", "response", "--controller", controller, *points)
            yield _run("measure", "noise", "--controller", controller, "--duration-s", "4")


def _run(*arguments: str) -> Said:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = tactuator(list(arguments))
    return Said(
        " ".join(arguments[:2]) if arguments[0] == "measure" else arguments[0],
        status,
        " ".join((out.getvalue() + err.getvalue()).split()),
    )


def faults(slip: Slip, said: list[Said]) -> list[str]:
    """Return what is wrong with what was said of a slip; empty where it is caught."""
    wrong = [f"{each.verb} ends in met" for each in said if each.is_met]
    wrong += [f"{each.verb} fails with {each.status}" for each in said if each.status not in (0, 1, 2)]
    if not any(slip.words in each.text for each in said):
        wrong.append(f"nobody says {slip.words!r}")
    if not any(each.status or each.doubts for each in said):
        wrong.append("every verb exits 0 without a word")
    return wrong


def alarms(said: list[Said]) -> list[str]:
    """Return what was said against right files: doubts of their numbers, and refusals."""
    return [f"{each.verb} {each.status}: {each.text}" for each in said if each.doubts or each.status not in (0, 1)]
