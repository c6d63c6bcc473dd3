"""Displays on sound cards: the subcommands of `sound`, and `calibrate-display`."""

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np

from tactuator import report
from tactuator.api.option import Argument, Option
from tactuator.api.parameters import Curve, MainsHz, Numbers, Place, Seed, chosen_display, numbers
from tactuator.api.progress import working
from tactuator.errors import BadInput, NoDesign
from tactuator.measure.open_loop import Calibrated, CalibrationRequest, NoEqualiser, calibrate
from tactuator.model.description import Display
from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.plain import picked
from tactuator.result import Chart, ChartLine, Column, Fact, Result, ResultTable, columns_of, data, found
from tactuator.rig.open import open_rig
from tactuator.rig.sound.cards import Card, Delay, full_scale_v, list_cards, measure_delay, tone, wire_display
from tactuator.rig.sound.rig import SoundRig

Device = Annotated[str, Option("Card, as `tactuator sound devices` lists it.")]
RateHz = Annotated[float, Option("Sampling rate.")]
Output = Annotated[int, Option("Output of the card, counted from 1.")]
Level = Annotated[float, Option("Share of full scale.")]


@dataclass(frozen=True, eq=False, repr=False)
class CardsResult(Result):
    """The sound cards that there are."""

    cards: tuple[Card, ...]

    def facts(self) -> Sequence[Fact]:
        return [
            Fact("devices", [asdict(card) | {"device": card.full_name} for card in self.cards]),
            *(
                found(card.full_name, f"{card.outputs} outputs, {card.inputs} inputs, {card.rate_hz:g} Hz")
                for card in self.cards
            ),
        ]

    def next_step(self) -> str:
        hint = "PortAudio finds no card; `aplay -l` lists those of ALSA, and a sound server may have to run"
        return "" if self.cards else hint


def devices() -> CardsResult:
    """Show the sound cards."""
    return CardsResult(tuple(list_cards()))


@dataclass(frozen=True, eq=False, repr=False)
class LatencyResult(Result):
    """The delay from an output to an input through a wire."""

    device: str
    rate_hz: float
    output: int
    input_number: int
    delay: Delay

    @property
    def holds(self) -> bool:
        return self.delay.spread <= 1

    def facts(self) -> Sequence[Fact]:
        samples = self.delay.samples
        return [
            Fact("device", self.device, "card", summary=True),
            found("wire", f"output {self.output} to input {self.input_number}"),
            Fact("rate_hz", self.rate_hz),
            Fact("latency_samples", samples, "latency_samples", summary=True),
            Fact("delay", self.delay),
            found("ms", f"{1e3 * samples / self.rate_hz:.3f}"),
            found("spread", self.delay.spread, "samples"),
            found("gain", self.delay.gain),
        ]


def latency(
    device: Device,
    rate_hz: RateHz = 48000.0,
    output: Output = 1,
    input_number: Annotated[int, Option("Input of the card that is wired to it.", ("--input",))] = 1,
    level: Level = 0.1,
) -> LatencyResult:
    """Measure the delay through a wire. For latency_samples of [sound]; `holds` is False if it changes."""
    if input_number < 1:
        raise BadInput(f"input {input_number}", "the input to which the wire leads, counted from 1")
    display = wire_display(rate_hz, output, input_number)
    with open_rig(f"sound:{device}", display) as rig, working("listening to the wire"):
        delay = measure_delay(rig, level, np.random.default_rng(0))
    return LatencyResult(device, rate_hz, output, input_number, delay)


@dataclass(frozen=True, eq=False, repr=False)
class FullScaleResult(Result):
    """Volts at full scale of an output, and of an input that a wire joins to it."""

    device: str
    output: int
    output_full_scale_v: float
    input_number: int = 0
    input_full_scale_v: float | None = None

    def facts(self) -> Sequence[Fact]:
        wired = {"input": self.input_number, "input_full_scale_v": self.input_full_scale_v}
        document = {"device": self.device, "output": self.output, "output_full_scale_v": self.output_full_scale_v}
        keys = document | (wired if self.input_number else {})
        return [Fact(name, value, name, form=".6g", summary=True) for name, value in keys.items()]

    def next_step(self) -> str:
        return "these are keys of [sound] in the display file"


def calibrate_output(
    device: Device,
    rate_hz: RateHz = 48000.0,
    output: Output = 1,
    frequency_hz: Annotated[float, Option("Of the tone.")] = 100.0,
    level: Level = 0.1,
    duration_s: Annotated[float, Option("Of the tone, for the meter to settle.")] = 15.0,
    reading_v: Annotated[float | None, Option("What the multimeter reads, V rms (default: asked for).")] = None,
    input_number: Annotated[int, Option("Input that is wired to the output, to calibrate; 0: none.", ("--input",))] = 0,
) -> FullScaleResult:
    """Turn a multimeter's reading into volts at full scale."""
    if reading_v is not None:
        full_scale_v(reading_v, 1.0)  # what is no reading is refused before the tone is played
    text = f"{frequency_hz:g} Hz at output {output} for {duration_s:g} s: read the multimeter (V rms)"
    with open_rig(f"sound:{device}", wire_display(rate_hz, output, input_number)) as rig, working(text):
        read_back = tone(rig, frequency_hz, level, duration_s)
    volts = full_scale_v(_asked_number() if reading_v is None else reading_v, level)
    return FullScaleResult(device, output, volts, input_number, volts * level / read_back if input_number else None)


def _asked_number() -> float:
    sys.stderr.write("what did the multimeter read, V rms? ")
    sys.stderr.flush()
    line = sys.stdin.readline()
    try:
        return float(line)
    except ValueError:
        raise BadInput(f"{line.strip()!r} was typed", "a number") from None


@dataclass(frozen=True, eq=False, repr=False)
class EqualisedResult(Result):
    """A display without loop that was calibrated and verified. out: the folder of its files; gaps: of the card."""

    calibrated: Calibrated
    out: Path
    gaps: int

    @property
    def holds(self) -> bool:
        return self.calibrated.flat

    def _shortfalls(self) -> dict[str, str]:
        allowed = self.calibrated.controller.display.objectives.flatness_db
        return {channel.name: channel.shortfall(allowed) for channel in self.calibrated.channels}

    def facts(self) -> Sequence[Fact]:
        shortfalls = self._shortfalls()
        channels = [
            picked(channel, **_KEYS) | {"shortfall": shortfalls[channel.name]} for channel in self.calibrated.channels
        ]
        within = {
            channel.name: f"{channel.usable.band_hz[0]:.4g} to {channel.usable.band_hz[1]:.4g} Hz within "
            f"{channel.last.worst_db:.2f} dB"
            for channel in self.calibrated.channels
        }
        return [
            Fact("flat", self.calibrated.flat, "felt flat", summary=True),
            *(found(name, f"NOT felt flat: {why}") for name, why in shortfalls.items() if why),
            *(found(name, words) for name, words in within.items()),
            Fact("out", self.out, "written", summary=True),
            *data({"gaps": self.gaps, "channels": channels}),
        ]

    def table(self) -> Sequence[Column]:
        rows = [
            (channel.name, *row)
            for channel in self.calibrated.channels
            for row in zip(channel.last.frequency_hz, channel.last.error_db, channel.last.confidence_db, strict=True)
        ]
        return columns_of(("channel", "frequency_hz", "error_db", "confidence_db"), rows)

    def chart(self) -> Chart:
        flats = [(channel.name, channel.last) for channel in self.calibrated.channels]
        curves = [ChartLine(f"{name}, ± 95 %", f.frequency_hz, f.error_db, "o", f.confidence_db) for name, f in flats]
        tolerance = self.calibrated.controller.display.objectives.flatness_db
        return Chart("frequency (Hz)", "level error (dB)", curves, True, (0.0,), tolerance, AMPLITUDE_JND_DB)

    def tables(self) -> Sequence[ResultTable | str]:
        rows = []
        for channel in self.calibrated.channels:
            low, high = channel.usable.band_hz
            spread = f"{channel.last.error_db.min():+.2f} to {channel.last.error_db.max():+.2f}"
            rows.append((channel.name, f"{low:.4g} to {high:.4g}", spread, channel.estimate.by, str(channel.rounds)))
        columns = ("channel", "usable (Hz)", "level error (dB)", "plant", "corrected")
        files = (f"written: {self.out / name}" for name in report.calibrated.FILES)
        return [ResultTable("", columns, tuple(rows)), *files]


_KEYS = {
    "channel": "name", "usable_band_hz": "usable.band_hz", "ends": "usable.ends", "worst_error_db": "last.worst_db",
    "first_worst_error_db": "first.worst_db", "frequency_hz": "last.frequency_hz", "error_db": "last.error_db",
    "confidence_db": "last.confidence_db", "plant": "followed.by", "departure_db": "followed.departure_db",
    "recorded_at_v": "level.volts", "rounds": "rounds",
}  # fmt: skip
"""Keys of a calibrated channel in JSON, each with its place."""


def calibrate_display(
    display: Annotated[
        Display | Place, Argument("Display file (TOML) with [sound]; its plants are replaced.", file=True)
    ],
    rig: Annotated[str, Option("Rig: sound:DEVICE[@RATE].")] = "sound:",
    out: Annotated[Place, Option("Folder to write.", type=Path, shell=Path("out/calibrated"))] = "out/calibrated",
    level_db_sl: Annotated[
        float, Option("Level at which it must be usable and is verified.")
    ] = CalibrationRequest.level_db_sl,
    band_hz: Annotated[Numbers, Option("Band to use at most: low,high.", type=str)] = "",
    mains_hz: MainsHz = None,
    curve: Curve = None,
    seed: Seed = 0,
) -> EqualisedResult:
    """Calibrate a display without loop. Finds level, model, usable band and equaliser, and verifies the felt level;
    `holds` is False if it is not flat.

    Raises BadInput for another rig, and NoDesign where there is no equaliser; what was measured is kept in `out`.

    >>> tt.calibrate_display("displays/exciter.toml", rig="simulated")
    Traceback (most recent call last):
    ...
    tactuator.errors.BadInput: rig 'simulated'; expected sound:DEVICE[@RATE], a display without loop on a sound card
    """
    described = chosen_display(display, curve)
    mains_hz = described.mains_hz(mains_hz, CalibrationRequest.mains_hz)
    asked = CalibrationRequest(_band(described, band_hz), level_db_sl, mains_hz)
    return _equalised(described, rig, Path(out), asked, seed)


def _equalised(described: Display, rig: str, out: Path, asked: CalibrationRequest, seed: int) -> EqualisedResult:
    if not rig.startswith("sound:"):
        raise BadInput(f"rig {rig!r}", "sound:DEVICE[@RATE], a display without loop on a sound card")
    with report.calibrated.calibrated_folder(out, described) as beside:
        try:
            with open_rig(rig, described, seed) as card, working("calibrating") as step:
                assert isinstance(card, SoundRig)
                calibrated = calibrate(card, asked, np.random.default_rng(seed), lambda text: step(text=text))
                gaps = card.gaps
        except NoEqualiser as reached:
            refused, names = reached, ", ".join(report.calibrated.write_measured(beside, reached, rig, _now()))
        else:
            report.calibrated.write_calibrated(beside, calibrated, asked, rig, _now(), gaps)
            return EqualisedResult(calibrated, out, gaps)
    raise NoDesign(
        f"{refused}. What was measured is kept in {out} ({names}); `tactuator design {out / 'display.toml'}` goes on "
        "from there, with a narrower band_hz or other poles"
    )


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _band(described: Display, band_hz: Numbers) -> tuple[float, float]:
    if isinstance(band_hz, str) and not band_hz:
        bands = [channel.threshold.band_hz for channel in described.channels]
        return max(low for low, _ in bands), min(high for _, high in bands)
    values = numbers(band_hz, "band_hz")
    if values.size != 2 or not 0.0 < values[0] < values[1]:
        raise BadInput(f"band {band_hz!r}", "two frequencies, low,high")
    return float(values[0]), float(values[1])
