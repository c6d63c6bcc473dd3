"""From a record to a model: calibrate, record, identify."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from tactuator import report
from tactuator.api.option import Argument, Option, option_of
from tactuator.api.parameters import (
    Figures,
    Load,
    Numbers,
    Place,
    RigOption,
    Seed,
    chosen_display,
    numbers,
    opened,
    paths,
    put_load,
)
from tactuator.api.progress import working
from tactuator.errors import BadInput, unknown
from tactuator.identification.by_response import ResponseFit, identify_response
from tactuator.identification.calibration import Calibration, fit_line
from tactuator.identification.identify import identify as identified
from tactuator.identification.options import Fixed, IdentifyOptions
from tactuator.identification.result import Identification
from tactuator.identification.validation import validated
from tactuator.io.column_name import NO_UNIT, QUANTITIES, unit_of
from tactuator.io.csv_tables import read_pairs
from tactuator.io.record import check_record_path, read_record, read_runs, write_record
from tactuator.io.response_table import NO_NAMES, ResponseColumns
from tactuator.model.description import Channel, Display
from tactuator.model.plant import DERIVATIVES
from tactuator.parameters import Wording
from tactuator.result import Fact, Result
from tactuator.rig.rig import require_sensors
from tactuator.signals import excitation as signals
from tactuator.signals.excitation import sample_count
from tactuator.signals.multisine import Periods, multisine, odd_lines
from tactuator.signals.record import FrequencyResponse, Record

EXCITATIONS = ("mix", "delimited", "steps", "noise", "prbs", "chirp", "multisine")
_LINES = 160


def calibrate_sensor(
    pairs: Annotated[
        Place | tuple[Numbers, Numbers],
        Wording("the path of a file, or a tuple of displacement_mm and voltage_v"),
        Argument("CSV with columns displacement_mm, voltage_v and, if any, name.", file=True, type=Path),
    ],
    gauge_error_mm: Annotated[float, Option("Standard error of the gauge.", ge=0)] = 0.0,
    strict: Annotated[bool, Option("Fail if a pair lies off the line.")] = False,
) -> Calibration:
    """Find the sensor gain from displacement and voltage. Pairs that lie off the line are rejected and named.

    pairs: their file, or displacement (mm) and voltage, (n,) each. Raises BadInput for pairs that make no line, and
    with `strict` where a pair is off it.

    >>> tt.calibrate_sensor("pairs.csv")
    <Calibration gain: 0.1992 ± 0.00024 V/mm, offset: 0.03181 ± 0.0014 V, refused: p10>
    """
    if isinstance(pairs, tuple):
        line = fit_line(*(numbers(each, "pairs") for each in pairs), gauge_error_mm=gauge_error_mm)
    else:
        read = read_pairs(Path(pairs))
        line = fit_line(read.displacement_mm, read.voltage_v, gauge_error_mm=gauge_error_mm, names=read.names)
    if line.refused and strict:
        raise BadInput("; ".join(map(str, line.refused)), "pairs on one line")
    return line


@dataclass(frozen=True, eq=False, repr=False)
class RecordingResult(Result):
    """A record that was taken. record: the file that has it, if any; taken: the record itself."""

    record: Path | None
    channel: str
    duration_s: float
    rate_hz: float
    command_peak_v: float
    position_peak_v: float
    saturated: bool
    beyond_travel: bool
    taken: Record = field(repr=False)

    def facts(self) -> Sequence[Fact]:
        return [
            Fact("record", self.record),
            Fact("channel", self.channel, "channel", summary=True),
            Fact("duration_s", self.duration_s, "duration", "s", "g", True),
            Fact("rate_hz", self.rate_hz, "sampling rate", "Hz", "g", True),
            Fact("command_peak_v", self.command_peak_v, "greatest command", "V", ".2f", True),
            Fact("position_peak_v", self.position_peak_v, "greatest position", "V of the sensor", ".3f", True),
            Fact("saturated", self.saturated, "a converter reached its limit, or the motion did", summary=True),
            Fact("beyond_travel", self.beyond_travel, "the motion went beyond travel_mm", summary=True),
        ]

    def next_step(self) -> str:
        return "" if self.record is None else f"tactuator identify {self.record} --out model.json"


def record(
    display: Annotated[Display | Place, Argument("Display file (TOML).", file=True)],
    channel: Annotated[str | None, Option("Channel (default: the first).")] = None,
    out: Annotated[Place | None, Option("Record to write (HDF5).", writes="record", shell=Path("record.h5"))] = None,
    duration_s: Annotated[float, Option("Seconds.")] = 60.0,
    excitation: Annotated[str, Option(f"Signal: {', '.join(EXCITATIONS)}.")] = "mix",
    travel_share: Annotated[float, Option("Share of the travel used.")] = 0.5,
    load: Load = "none",
    rig: RigOption = "simulated",
    seed: Seed = 0,
    periods: Annotated[int, Option("Of each multisine; the first one settles.")] = 3,
    realisations: Annotated[int, Option("Multisines of new phases.")] = 4,
) -> RecordingResult:
    """Drive one channel and record. The excitation is planned within travel and range.

    Raises BadInput for an excitation, a share or a load that there is not, and where the rig has no sensor.

    >>> tt.record("display.toml", duration_s=4.0, excitation="noise").headline()["channel"]
    'index'
    """
    if out is not None:
        check_record_path(Path(out))
    described = chosen_display(display)
    driven = described.channel(channel or described.channels[0].name)
    command, plan = _planned(described, driven, duration_s, excitation, travel_share, seed, periods, realisations)
    with opened(rig, described, seed) as ready:
        require_sensors(ready, (driven.name,))
        put_load(ready, (driven,), load)
        column = ready.channels.index(driven.name)
        commands = np.zeros((command.size, len(ready.channels)))
        commands[:, column] = command
        with working(f"recording {duration_s:g} s"):
            trace = ready.drive(commands)
            ready.rest()
    about = {"load": load, "display": described.name, "channel": driven.name, "quantity": driven.quantity}
    about |= {"excitation": excitation, **plan, **_made_by(rig if isinstance(rig, str) else type(rig).__name__)}
    taken = Record(trace.rate_hz, trace.command_v[:, column], trace.position_v[:, column], about=about)
    peak_v = float(np.max(np.abs(taken.position)))
    if out is not None:
        write_record(Path(out), taken)
    return RecordingResult(
        None if out is None else Path(out),
        driven.name,
        command.size / trace.rate_hz,
        trace.rate_hz,
        float(np.max(np.abs(command))),
        peak_v,
        bool(np.any(trace.saturated[:, column])),
        peak_v > float(ready.travel_v[column]),
        taken,
    )


def _made_by(rig: str) -> dict[str, str]:
    """Return what a record says of the rig that made it."""
    # a sound card's converters are band-limited, every other rig's hold the command between its samples
    about = {"rig": rig, "hold": "band-limited" if rig.startswith("sound:") else "zero-order"}
    return about if rig == "simulated" else about | {"date": datetime.now(UTC).isoformat(timespec="seconds")}


_READ = 0.5
"""Share of the input's full scale that a sensor of velocity or acceleration is planned to reach."""


def _planned(
    display: Display,
    channel: Channel,
    duration_s: float,
    excitation: str,
    travel_share: float,
    seed: int,
    periods: int,
    realisations: int,
) -> tuple[NDArray[np.float64], dict[str, str]]:
    """Return the command (n,), volts, as large as the share of travel and 0.9 of the range allow by the display's
    plant, and what the record has to say of it.
    """
    rate_hz = display.rate_hz
    if excitation not in EXCITATIONS:
        raise unknown("excitation", excitation, EXCITATIONS)
    if not 0.0 < travel_share <= 1.0:
        raise BadInput(f"{travel_share:g}", "above 0 and at most 1", key="travel_share")
    rng, order = np.random.default_rng(seed), DERIVATIVES[channel.quantity]
    low, high = channel.threshold.band_hz
    travel_v = travel_share * channel.travel_mm * channel.sensor_gain_v_per_mm
    plan: dict[str, str] = {}
    if excitation in ("mix", "delimited"):
        band, at_most = (low, min(high, 0.4 * rate_hz)), channel.converter.range_v
        shape = signals.paper_mix(
            duration_s, rate_hz, at_most, rng, plant=channel.plant if order == 0 else None, travel_v=travel_v,
            band_hz=band, delimited=excitation == "delimited",
        )  # fmt: skip
        if order == 0:
            return shape, plan
    elif excitation == "multisine":
        shape, plan = _multisines(channel, rate_hz, duration_s, rng, periods, realisations)
    elif excitation == "steps":
        shape = signals.steps(duration_s, rate_hz, min(1.3, 0.1 * duration_s), rng)
    elif excitation == "noise":
        shape = signals.noise(duration_s, rate_hz, (low, 1.2 * high), rng)
    elif excitation == "prbs":
        shape = signals.prbs(duration_s, rate_hz, min(2.5 * high, rate_hz), rng)
    else:
        shape = signals.log_chirp(duration_s, rate_hz, low, high)
    range_v = 0.9 * channel.converter.range_v
    if order == 0:
        return shape * signals.plan_amplitude(shape, rate_hz, channel.plant, travel_v, range_v), plan
    known_hz, full_v = channel.valid_hz or (low, 1.2 * high), channel.converter.range_v
    if display.sound is not None:
        full_v = display.sound.wires[display.channels.index(channel)].input_full_scale_v
    limits_v = (travel_v, _READ * full_v, range_v)
    return signals.known_part(shape, rate_hz, channel.plant, order, known_hz, limits_v), plan


def _multisines(
    channel: Channel,
    rate_hz: float,
    duration_s: float,
    rng: np.random.Generator,
    periods: int,
    realisations: int,
) -> tuple[NDArray[np.float64], dict[str, str]]:
    """Return several odd multisines of random phases (n,), and what their record has to say.

    periods: of each multisine, the first of them to settle. Lines are the louder the less the plant answers (by the
    root of it). Raises BadInput where a period shows too few lines of the band.
    """
    if periods < 3 or realisations < 1:
        raise BadInput(f"{realisations} realisations of {periods} periods", "1 or more of 3 or more")
    period = sample_count(duration_s / (periods * realisations), rate_hz)
    low, high = channel.threshold.band_hz
    lines = odd_lines((low, min(high, 0.4 * rate_hz)), rate_hz, period, _LINES, rng)
    answer = np.abs(channel.plant.response(lines * rate_hz / period))
    peaks = np.sqrt(np.max(answer) / np.maximum(answer, 1e-4 * np.max(answer)))
    waves = [multisine(rate_hz, period, lines, peaks, rng, rounds=1).one_period() for _ in range(realisations)]
    plan = Periods(period, periods, realisations, lines).attributes()
    return np.concatenate([np.tile(wave, periods) for wave in waves]), plan


def identify(
    records: Annotated[
        Record | FrequencyResponse | Place | Sequence[Record | Place],
        Argument("Record, or several of one mechanism: HDF5, CSV, MATLAB or WAV.", file=True, type=list[Path]),
    ],
    input: Annotated[str | None, Option("Column or variable of the command.")] = None,
    output: Annotated[str | None, Option("Column or variable of the position.")] = None,
    reference: Annotated[str | None, Option("Column or variable of a closed loop's reference.")] = None,
    time: Annotated[str | None, Option("Column or variable of the time stamps.")] = None,
    rate_hz: Annotated[float | None, Option("Sampling rate, where the file has none.")] = None,
    frequency: Annotated[str | None, Option("Of a response: column of the frequency.")] = None,
    magnitude: Annotated[str | None, Option("Of a response: column of the magnitude, linear or in dB.")] = None,
    phase: Annotated[str | None, Option("Of a response: column of the phase.")] = None,
    real: Annotated[str | None, Option("Of a response: column of the real part.")] = None,
    imaginary: Annotated[str | None, Option("Of a response: column of the imaginary part.")] = None,
    ignore: Annotated[Sequence[str], Option("Of a response: column to leave unread.", type=list[str])] = (),
    from_s: Annotated[float | None, Option("Use the record from here on.")] = None,
    to_s: Annotated[float | None, Option("Use the record up to here.")] = None,
    order: Annotated[int | None, option_of(IdentifyOptions, "order")] = IdentifyOptions.order,
    zeros: Annotated[int | None, option_of(IdentifyOptions, "zeros")] = IdentifyOptions.zeros,
    integrators: Annotated[int, option_of(IdentifyOptions, "integrators")] = IdentifyOptions.integrators,
    fix: Annotated[Sequence[str], option_of(IdentifyOptions, "fixed", "--fix", type=list[str])] = (),
    hold: Annotated[str, option_of(IdentifyOptions, "hold")] = IdentifyOptions.hold,
    closed_loop: Annotated[str, option_of(IdentifyOptions, "closed_loop")] = IdentifyOptions.closed_loop,
    method: Annotated[str, option_of(IdentifyOptions, "method")] = IdentifyOptions.method,
    quantity: Annotated[str, option_of(IdentifyOptions, "quantity")] = IdentifyOptions.quantity,
    forgetting: Annotated[float, option_of(IdentifyOptions, "forgetting")] = IdentifyOptions.forgetting,
    friction: Annotated[
        bool, option_of(IdentifyOptions, "friction", "--friction/--no-friction")
    ] = IdentifyOptions.friction,
    validate: Annotated[
        Record | Place | Sequence[Record | Place] | None,
        Option(
            "Another record, to test the model on.",
            file=True,
            type=list[Path] | None,
        ),
    ] = None,
    out: Annotated[Place | None, Option("Model file to write (JSON).", writes="model")] = None,
    figures: Figures = None,
) -> Identification | ResponseFit:
    """Identify a model of a recorded mechanism. `holds` is False if the model is not to be trusted.

    records: one, or several of one mechanism, or their files; or a frequency response or its file. A column is named
    as NAME, or with its unit as NAME=UNIT. Raises BadInput for a record that says nothing.

    >>> record = tt.read_record("bench.csv", input="drive", output="encoder", time="t")
    >>> tt.identify(record, order=2, zeros=0, hold="zero-order", friction=False).order
    2
    """
    fixed = tuple(map(Fixed.parse, fix))
    asked = IdentifyOptions(order, zeros, integrators, hold, quantity, friction, fixed, closed_loop, method, forgetting)  # type: ignore[arg-type]
    names: dict[str, Any] = {"input": input, "output": output, "reference": reference, "time": time}
    names["rate_hz"] = rate_hz
    columns = ResponseColumns(frequency, magnitude, phase, real, imaginary, tuple(ignore))
    if not (sources := paths(records)):
        raise BadInput("no record", "one or more")
    source, *more = sources
    span = {"from_s": from_s, "to_s": to_s}
    first = source if isinstance(source, FrequencyResponse) else _read(source, columns, names | span)
    fit: Identification | ResponseFit
    if isinstance(first, FrequencyResponse):
        _require_quantity(first, asked.quantity)
        if more or paths(validate):
            raise BadInput("a frequency response beside other files", "one response by itself")
        fit = _response_model(first, asked)
    else:
        _require_quantity(first[0], asked.quantity)
        parts = [*first, *(run for each in more for run in _runs(each, names | span))]
        fit = _record_model(parts, [_unseen(each, names) for each in paths(validate)], asked)
    if out is not None:
        fit = replace(fit, out=Path(out))
        fit.write(out)
    if figures is not None and isinstance(fit, Identification):
        report.device_figures.save_identification(fit, Path(figures))
    return fit


def _require_quantity(given: Record | FrequencyResponse, quantity: str) -> None:
    """Raise BadInput for a quantity that the unit of what was measured contradicts."""
    unit = given.position_unit if isinstance(given, Record) else given.about.get("unit", "")
    kind = (unit_of(unit) or NO_UNIT).kind
    if quantity != "auto" and kind in QUANTITIES and kind != quantity:
        raise BadInput(f"{quantity!r}, while the position is in {unit}", f"{kind!r}, or another unit", key="quantity")


def _read(
    source: Record | Place, columns: ResponseColumns, names: Mapping[str, Any]
) -> list[Record] | FrequencyResponse:
    """Return the runs of a record or of its file between two times, or the response that a file has."""
    if isinstance(source, Record):
        return [_part_of(source, names["from_s"], names["to_s"])]
    return read_runs(Path(source), columns, **names)


def _runs(source: Record | Place, names: Mapping[str, Any]) -> list[Record]:
    """Return the runs of a record. Raises BadInput for a file that has a response."""
    read = _read(source, NO_NAMES, names)
    if isinstance(read, FrequencyResponse):
        raise BadInput(f"{source} has a frequency response", "records beside a record")
    return read


def _unseen(source: Record | Place, names: Mapping[str, Any]) -> tuple[str, Record]:
    """Return a record and its name."""
    return ("record", source) if isinstance(source, Record) else (str(source), read_record(Path(source), **names))


def _record_model(parts: list[Record], unseen: list[tuple[str, Record]], asked: IdentifyOptions) -> Identification:
    doubts = ["identifying"]
    with working("identifying") as step:

        def note(text: str) -> None:
            step(text=f"{', not to be trusted for '.join(doubts)}: {text}")

        fit = identified(parts, note=note, warn=doubts.append, **vars(asked))
        note("validating")
        return replace(validated(fit, unseen), about=parts[0].about)


def _response_model(response: FrequencyResponse, asked: IdentifyOptions) -> ResponseFit:
    with working("identifying") as step:
        return identify_response(response, asked, lambda text: step(text=f"identifying: {text}"))


def _part_of(record: Record, from_s: float | None, to_s: float | None) -> Record:
    """Return the record between two times, seconds from its first sample; BadInput where that is nothing."""
    if from_s is None and to_s is None:
        return record
    return record.between(from_s or 0.0, record.duration_s if to_s is None else to_s)
