"""Functions that measure a display: noise, response, crosstalk, disturbance, finger."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from tactuator import report
from tactuator.api.crosstalk import CrosstalkResult
from tactuator.api.option import Option
from tactuator.api.parameters import (
    Channels,
    ControllerOption,
    DisplayOption,
    Figures,
    Load,
    MainsHz,
    Numbers,
    Place,
    RigOption,
    Seed,
    chosen_controller,
    numbers,
    opened,
    put_on,
    require_stable,
)
from tactuator.api.progress import say, working
from tactuator.arrays import FloatArray
from tactuator.errors import unknown
from tactuator.io.environment import write_environment
from tactuator.io.response import check_response_path, write_responses
from tactuator.measure.adaptive import Learnt, settle_weights
from tactuator.measure.crosstalk import Crosstalk, felt_elsewhere
from tactuator.measure.disturbance import DisturbanceReport, disturbance
from tactuator.measure.error import ResponseLevels, as_read, level_within_limits, response_verdict, with_tones
from tactuator.measure.finger import CANNOT_TELL, CHAIN, NEITHER, ONE, FingerEstimate, measure_finger
from tactuator.measure.noise import FeltNoise, felt_noise, noise_verdict, proportional_controller, unstable_channels
from tactuator.measure.options import (
    EXCURSION_MM,
    FINGER_LEVEL_DB_SL,
    FINGER_S,
    LISTENED_S,
    MAINS_HZ,
    METHODS,
    PROBED_GAINS,
    REJECTION_HZ,
    MeasurementOptions,
)
from tactuator.measure.response import check_frequencies, multisine_played, multisine_response, stepped_sine
from tactuator.model.controller import Controller
from tactuator.model.verdict import Verdict
from tactuator.parameters import checked
from tactuator.perception.curve import AMPLITUDE_JND_DB
from tactuator.plain import picked
from tactuator.result import Chart, ChartLine, Column, Fact, Result, ResultTable, columns_of, data, found, text_table
from tactuator.rig.rig import Rig, usual_load
from tactuator.signals.decibels import db
from tactuator.signals.multisine import over_the_band
from tactuator.signals.record import Response

_LEVEL = ("--level-db-sl", "--level")
_LIFTED_S = 3.0
"""Time for a person to lift a finger."""


def _listed(values: Sequence[float]) -> str:
    return ",".join(f"{value:g}" for value in values)


@dataclass(frozen=True, eq=False, repr=False)
class FeltLevels(Result):
    """Hum and noise as a resting finger feels them, under probing gains and under the loop.

    runs: what each controller was called, and the felt noise of each channel under it, the loop last. not_played: why
    others were not. verdict: on what is felt under the loop. written: the file with the sensor's own hum and noise.
    """

    runs: tuple[tuple[str, tuple[FeltNoise, ...]], ...]
    not_played: Mapping[str, str]
    verdict: Verdict
    written: Path | None = None

    @property
    def channels(self) -> tuple[FeltNoise, ...]:
        """Return what is felt of each channel under the loop."""
        return self.runs[-1][1]

    @property
    def holds(self) -> bool:
        return self.verdict.holds

    def facts(self) -> Sequence[Fact]:
        runs = [
            {"under": name, "channels": [_felt_document(felt) for felt in channels]} for name, channels in self.runs
        ]
        return [
            *self.verdict.told(),
            *(found(felt.channel, _felt_words(felt)) for felt in self.channels),
            *data({"runs": runs, "not_played": self.not_played}),
            Fact("written", self.written),
            *data(self.verdict.document()),
        ]

    def next_step(self) -> str:
        path = self.written
        return f'measured = "{path.name}" under [environment] judges by what was measured' if path else ""

    def table(self) -> Sequence[Column]:
        rows = [
            (felt.channel, hertz, level)
            for felt in self.channels
            for hertz, level in zip(felt.band_hz, felt.band_db_sl, strict=True)
        ]
        return columns_of(("channel", "band_hz", "level_db_sl"), rows)

    def chart(self) -> Chart:
        curves = []
        for number, felt in enumerate(self.channels):
            curves += [
                ChartLine(f"{felt.channel}, third octaves", felt.band_hz, felt.band_db_sl, "o-", colour=number),
                ChartLine(f"{felt.channel}, mains lines", felt.line_hz, felt.line_db_sl, "D", colour=number),
            ]
        return Chart("frequency (Hz)", "felt level (dB SL)", curves, log_x=True, limits={"threshold": 0.0})

    def tables(self) -> Sequence[ResultTable | str]:
        columns = ("under", "channel", "worst mains line (dB SL)", "worst third octave (dB SL)", "resonance (dB SL)")
        rows = tuple((name, *_felt_row(felt)) for name, channels in self.runs for felt in channels)
        measured = [felt for felt in self.channels if felt.sensor is not None]
        return [
            ResultTable("", columns, rows, ("levels as a finger feels them",)),
            *(f"not played: {name}: {why}" for name, why in self.not_played.items()),
            *(f"measured, {felt.channel}: {felt.sensor.environment()}" for felt in measured if felt.sensor),
            *self.verdict.tables(),
        ]


def _felt_words(felt: FeltNoise) -> str:
    return f"hum up to {felt.worst_line_db_sl:.1f} dB SL, noise up to {max(felt.band_db_sl):.1f} dB SL"


def _felt_document(felt: FeltNoise) -> dict[str, Any]:
    sensor = {"sensor": None if felt.sensor is None else vars(felt.sensor)}
    return vars(felt) | sensor | picked(felt, "worst_line_db_sl", "worst_noise_db_sl")


def _felt_row(felt: FeltNoise) -> tuple[str, ...]:
    resonance = "none" if felt.resonance_hz is None else f"{felt.resonance_db_sl:.1f} at {felt.resonance_hz:.0f} Hz"
    worst = (felt.worst_line_db_sl, float(max(felt.band_db_sl)))
    return felt.channel, *(f"{level:.1f}" if isfinite(level) else "none" for level in worst), resonance


def measure_noise(
    rig: RigOption,
    controller: ControllerOption = None,
    duration_s: Annotated[float, Option("Seconds listened to each.")] = LISTENED_S,
    load: Load = "none",
    *,
    display: DisplayOption = None,
    gains: Annotated[
        Numbers,
        Option("Proportional gains, with commas; empty: none.", type=str, shell=_listed(PROBED_GAINS)),
    ] = (),
    mains_hz: MainsHz = None,
    write: Annotated[
        Place | None,
        Option("File for the sensor's hum and noise, for [environment] measured.", writes="environment"),
    ] = None,
    seed: Seed = 0,
) -> FeltLevels:
    """Compare felt hum and noise with the threshold. Under proportional gains, then the loop; `holds` is False if felt.

    The display is held at rest. An open rig is used as it is. Raises BadInput for a loop that is unstable by the
    display's models.

    >>> [felt.channel for felt in tt.measure_noise(rig, controller, duration_s=4.0).channels]
    ['index', 'thumb', 'middle']
    """
    loop = chosen_controller(display, controller)
    require_stable(loop, load)
    mains_hz = loop.display.mains_hz(mains_hz, MAINS_HZ)
    open_loops = [channel.name for channel in loop.channels if channel.feedback_sos is None]
    probes, not_played = _probes(loop, gains, load)
    runs = []
    for name, candidate in [*probes, ("loop", loop)]:
        with working(f"listening under {name}"), opened(rig, candidate.display, seed) as ready:
            touching = put_on(ready, candidate, load)
            ready.load(candidate)
            felt = felt_noise(ready, loop.display, duration_s=duration_s, load=touching, mains_hz=mains_hz or None)
            runs.append((name, tuple(felt)))
    measured = runs[-1][1]
    path = None if write is None else Path(write)
    if path is not None:
        write_environment(path, {felt.channel: felt.sensor.keys() for felt in measured if felt.sensor is not None})
    return FeltLevels(tuple(runs), not_played, noise_verdict(measured, loop.display, open_loops), path)


def _probes(loop: Controller, gains: Numbers, load: str) -> tuple[list[tuple[str, Controller]], dict[str, str]]:
    """Return the proportional controllers to listen to, by name, and why others are not played."""
    played: list[tuple[str, Controller]] = []
    not_played: dict[str, str] = {}
    for gain in numbers(gains, "gains").tolist():
        name, probe = f"gain {gain:g}", proportional_controller(loop.display, gain)
        unstable = unstable_channels(probe, load)
        if any(channel.feedback_sos is None for channel in loop.channels):
            not_played[name] = "the display is driven without a loop: there is nothing to close"
        elif unstable:
            not_played[name] = f"the display's models call the loop of {', '.join(unstable)} unstable"
        else:
            played.append((name, probe))
    return played, not_played


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredResponses(Result):
    """Responses of a display, one for each channel, at one level and load.

    learnt: what adaptive channels had learnt before. verdict: whether they are felt flat.
    """

    responses: tuple[Response, ...]
    controller: Controller
    learnt: tuple[Learnt, ...]
    verdict: Verdict

    @property
    def reached(self) -> bool:
        """Return whether the confidence was reached everywhere."""
        return all(bool(response.reached.all()) for response in self.responses)

    @property
    def holds(self) -> bool:
        return self.reached and self.verdict.holds

    def notices(self) -> Sequence[str]:
        return () if self.reached else ("the confidence was not reached everywhere in the time allowed",)

    def _levels(self) -> list[tuple[Response, ResponseLevels]]:
        return [(response, ResponseLevels.of(response, self.controller)) for response in self.responses]

    def facts(self) -> Sequence[Fact]:
        responses = [
            picked(response, *_OF_RESPONSE) | picked(levels, "error_db", "error_jnd", **_OF_LEVELS)
            for response, levels in self._levels()
        ]
        return [
            *self.verdict.told(),
            *(found(response.channel, _felt_within(response, levels)) for response, levels in self._levels()),
            *data({"responses": responses, "learnt": [vars(learnt) for learnt in self.learnt]}),
            *data(self.verdict.document()),
        ]

    def table(self) -> Sequence[Column]:
        pairs = self._levels()

        def column(
            name: str,
            values: Callable[[Response, ResponseLevels], Any],
            words: str,
            form: str | Callable[[Any], str] = ".4g",
        ) -> Column:
            return Column(name, [value for pair in pairs for value in np.asarray(values(*pair)).tolist()], words, form)

        was_cut = any(response.saturated.any() for response in self.responses)
        return [
            column("channel", lambda response, levels: [response.channel] * response.frequency_hz.size, "channel"),
            column("frequency_hz", lambda response, levels: response.frequency_hz, "Hz"),
            column("level_db_sl", lambda response, levels: levels.felt_db_sl, "felt", ".2f"),
            column("error_db", lambda response, levels: levels.error_db, "error dB", "+.2f"),
            column("confidence_db", lambda response, levels: response.confidence_db, "± dB", _half),
            column("error_jnd", lambda response, levels: levels.error_jnd, "JND", ".1f"),
            column("prefilter_error_db", lambda response, levels: levels.prefilter_db, "filter", "+.2f"),
            column("load_error_db", lambda response, levels: levels.load_db, "load", "+.2f"),
            column("rest_error_db", lambda response, levels: levels.unpredicted_db, "rest", "+.2f"),
            column("phase_deg", lambda response, levels: np.degrees(response.phase_rad), "phase °", ".1f"),
            column("latency_ms", lambda response, levels: 1e3 * response.latency_s, "delay ms", ".2f"),
            column("distortion_db", lambda response, levels: _distortion_db(response), "dist.", _distortion),
            column("saturated", lambda response, levels: response.saturated, "cut" * was_cut, _yes),
        ]

    def chart(self) -> Chart:
        curves = []
        for number, (response, levels) in enumerate(self._levels()):
            hertz, half, cut = response.frequency_hz, response.confidence_db, response.saturated
            words = "what its model expects" if number == 0 else ""
            curves += [
                ChartLine(f"{response.channel}, ± 95 %", hertz, levels.felt_db_sl, "o", half, cut, number),
                ChartLine(words, hertz, levels.predicted_db_sl, ":", colour=number),
            ]
        targets = sorted({response.level_db_sl for response in self.responses})
        tolerance = self.controller.display.objectives.flatness_db
        return Chart("frequency (Hz)", "felt level (dB SL)", curves, True, targets, tolerance, AMPLITUDE_JND_DB)

    @checked
    def write(self, path: Place) -> None:
        """Write the responses as .h5 or .csv."""
        write_responses(Path(path), self.responses)

    def tables(self) -> Sequence[ResultTable | str]:
        table = self.table()
        cut = "; cut: a limit was reached" if table[-1].words else ""
        note = (
            "felt: dB SL; error: felt − requested, dB; JND: the error in just-noticeable differences of "
            f"{AMPLITUDE_JND_DB:g} dB; filter, load: what of the error the controller's own model expects of its "
            "prefilter and the load; rest: what it does not expect: friction, noise, another plant or load; delay: of "
            f"the phase; dist.: distortion against the fundamental, dB{cut}"
        )
        return [text_table(table, notes=[note]), *map(_learnt_line, self.learnt), *self.verdict.tables()]


_OF_RESPONSE = (
    *("channel", "load", "level_db_sl", "method", "controller_hash", "frequency_hz", "magnitude_v"),
    *("magnitude_db", "phase_rad", "latency_s", "confidence_db", "noise_v", "distortion_v", "saturated"),
    *("reached", "averaged_s"),
)
_OF_LEVELS = {
    "sensation_level_db": "felt_db_sl", "model_error_db": "model_db", "prefilter_error_db": "prefilter_db",
    "load_error_db": "load_db", "rest_error_db": "unpredicted_db", "expected_level_db_sl": "predicted_db_sl",
}  # fmt: skip
"""Keys of a response in JSON, and of its levels, each with its attribute."""


def _felt_within(response: Response, levels: ResponseLevels) -> str:
    hertz = response.frequency_hz
    where = f"{hertz.size} frequencies" if hertz.size > 1 else f"{hertz[0]:g} Hz"
    return (
        f"felt within {abs(levels.error_db).max():.2f} dB of {response.level_db_sl:g} dB SL "
        f"({levels.error_jnd.max():.1f} JND) at {where} (load {response.load})"
    )


def _half(half_db: float) -> str:
    return "<0.001" if half_db < 0.001 else f"{half_db:.2g}"


def _distortion_db(response: Response) -> FloatArray:
    """Return the distortion against the fundamental, (m,); minus infinity without any."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio_db = db(response.distortion_v / response.magnitude_v)
    return np.where(response.magnitude_v > 0.0, ratio_db, np.inf)


def _distortion(level_db: float) -> str:
    return "none" if level_db == -inf else f"{level_db:.0f}"


def _yes(is_so: bool) -> str:
    return "yes" if is_so else ""


def _learnt_line(learnt: Learnt) -> str:
    if learnt.weight is None:
        return f"{learnt.channel}: adaptive; the rig does not report its weights"
    mass, rest = learnt.weight
    after = "not settled" if learnt.settled_s is None else f"settled after {learnt.settled_s:.2f} s"
    return f"{learnt.channel}: weight {mass:.2f} of the mass, {rest:.2f} of damping and stiffness, {after}"


Frequencies = Annotated[Numbers, Option("Frequencies, with commas (default: 30 over the band).", type=str | None)]
_USUAL_LEVEL = "Level, dB SL (-60..55; default: 30, or what stays within the limits by the model)."
LevelOption = Annotated[float | None, Option(_USUAL_LEVEL, _LEVEL)]
Confidence = Annotated[float, Option("95 % half-width to reach.")]
Longest = Annotated[float, Option("Seconds per point at most.")]


def measure_response(
    rig: RigOption,
    controller: ControllerOption = None,
    frequency_hz: Frequencies = None,
    level_db_sl: LevelOption = None,
    load: Load = "none",
    mains_hz: MainsHz = None,
    *,
    display: DisplayOption = None,
    method: Annotated[str, Option("Method: stepped or multisine.")] = "stepped",
    channel: Channels = None,
    confidence_db: Confidence = MeasurementOptions.confidence_db,
    longest_s: Longest = MeasurementOptions.longest_s,
    coverage: float = MeasurementOptions.coverage,
    out: Annotated[Place | None, Option("Response to write (.h5 or .csv).", writes="measured")] = None,
    figures: Figures = None,
    seed: Seed = 0,
) -> MeasuredResponses:
    """Measure the response at a level. Frequencies keep 2 Hz off multiples of mains; `holds` is False if
    it is not flat, or the confidence was not reached.

    An open rig is used as it is; frequency_hz: (m,); mains_hz: 0 for no mains; coverage: of the
    confidence, 0 to 1. Raises BadInput for another load or level, and for a loop that is
    unstable.

    >>> tt.measure_response(rig, controller, [10.0, 100.0]).columns()["frequency_hz"][:2]
    [10.0, 100.0]
    """
    if method not in METHODS:
        raise unknown("method", method, METHODS)
    if out is not None:
        check_response_path(Path(out))
    loop = chosen_controller(display, controller)
    usual = MeasurementOptions.level_db_sl if level_db_sl is None else level_db_sl
    asked = MeasurementOptions(usual, channel, load, confidence_db, longest_s, coverage)
    exactly = frequency_hz is not None
    with _prepared(rig, loop, asked, mains_hz, frequency_hz, channel, seed) as (ready, options, wanted, learnt):
        if level_db_sl is None:
            options = _within_limits(ready, loop, options, wanted, method, exactly, seed)
        if method == "stepped":
            with working("response", wanted.size) as step:
                played = stepped_sine(ready, wanted, options, progress=step)
        else:
            with working("multisine"):
                rng = np.random.default_rng(seed)
                played = multisine_response(ready, wanted, options, rng, exactly=exactly)
        responses = tuple(as_read(each, loop, confidence_db) for each in played)
        if options.load == "none":
            with working("between the points"):
                responses = with_tones(ready, loop, responses, options, np.random.default_rng(seed))
    measured = MeasuredResponses(responses, loop, tuple(learnt), response_verdict(responses, loop.display))
    if out is not None:
        measured.write(out)
    if figures is not None:
        report.device_figures.save_measured(responses, loop, Path(figures))
    return measured


def _within_limits(
    rig: Rig, loop: Controller, options: MeasurementOptions, wanted: FloatArray, method: str, exactly: bool, seed: int
) -> MeasurementOptions:
    """Return options with the level lowered as far as the display's limits ask by the model; say so where it is."""
    names, played = options.channels or rig.channels, None
    if method == "multisine":
        played = multisine_played(rig, wanted, options, np.random.default_rng(seed), exactly=exactly)
    level = level_within_limits(loop, names, wanted, options.level_db_sl, played)
    if level < options.level_db_sl:
        say(f"level {level:g} dB SL: {options.level_db_sl:g} would pass the comfort limit, the range or the travel")
    return replace(options, level_db_sl=level)


def measure_crosstalk(
    rig: RigOption,
    controller: ControllerOption = None,
    frequency_hz: Frequencies = None,
    level_db_sl: LevelOption = None,
    load: Load = "none",
    mains_hz: MainsHz = None,
    *,
    display: DisplayOption = None,
    channel: Channels = None,
    confidence_db: Confidence = MeasurementOptions.confidence_db,
    longest_s: Longest = MeasurementOptions.longest_s,
    seed: Seed = 0,
) -> CrosstalkResult:
    """Measure what other fingers feel. Channels are driven one after the other; `holds` is False if a
    finger may feel another channel.

    channel: to be driven. The other parameters are those of `measure_response`.

    >>> tt.measure_crosstalk(rig, controller, [30.0], channel=["index"], longest_s=2.0).columns()["channel"]
    ['thumb', 'middle']
    """
    loop = chosen_controller(display, controller)
    usual = MeasurementOptions.level_db_sl if level_db_sl is None else level_db_sl
    asked = MeasurementOptions(usual, channel, load, confidence_db, longest_s)
    rows: list[Crosstalk] = []
    with _prepared(rig, loop, asked, mains_hz, frequency_hz, None, seed) as (ready, options, wanted, _):
        if level_db_sl is None:
            options = _within_limits(ready, loop, options, wanted, "stepped", True, seed)
        for name in options.channels or ready.channels:
            with working(f"driving {name}") as step:
                rows += felt_elsewhere(ready, name, wanted, options, progress=step)
    return CrosstalkResult(options.level_db_sl, tuple(rows))


@contextmanager
def _prepared(
    rig: RigOption,
    loop: Controller,
    asked: MeasurementOptions,
    mains_hz: float | None,
    frequency_hz: Numbers,
    touched: Sequence[str] | None,
    seed: int,
) -> Iterator[tuple[Rig, MeasurementOptions, NDArray[np.float64], tuple[Learnt, ...]]]:
    """Open the rig, put the load on the channels `touched` (None: all), load the controller and let it learn.

    Yield the rig, the options with what the display adds to them, the frequencies to measure, and what was learnt.
    """
    require_stable(loop, asked.load)
    band_hz, mains_hz = _common_band(loop, asked.channels), loop.display.mains_hz(mains_hz, MAINS_HZ)
    wanted = over_the_band(band_hz, mains_hz) if frequency_hz is None else numbers(frequency_hz, "frequency_hz")
    with opened(rig, loop.display, seed) as ready:
        touching = put_on(ready, loop, asked.load, touched)
        options = replace(asked, load=touching, mains_hz=mains_hz, band_hz=band_hz, controller_hash=loop.content_hash)
        check_frequencies(ready, wanted, band_hz)
        ready.load(loop)
        yield ready, options, wanted, settle_weights(ready, loop, asked.level_db_sl, np.random.default_rng(seed))


def _common_band(controller: Controller, channels: Sequence[str] | None) -> tuple[float, float]:
    measured = [controller.display.channel(name) for name in channels] if channels else controller.display.channels
    bands = [each.threshold.band_hz for each in measured]
    return max(low for low, _ in bands), min(high for _, high in bands)


@dataclass(frozen=True, eq=False, repr=False)
class DisturbanceResult(Result):
    """The effect of a pressing, lifting and trembling finger, one each for each channel."""

    reports: tuple[DisturbanceReport, ...]

    def facts(self) -> Sequence[Fact]:
        channels = [
            {"channel": each.channel, "unit": each.unit}
            | {name: vars(getattr(each, name)) for name in ("rejection", "press", "tremor")}
            for each in self.reports
        ]
        pressed = {
            each.channel: f"press {each.press.peak_mm:.3g} {each.unit}, within a tenth after "
            f"{each.press.recovery_s:.2f} s"
            for each in self.reports
        }
        return [Fact("channels", channels), *(found(name, words) for name, words in pressed.items())]

    def table(self) -> Sequence[Column]:
        def over_all(name: str) -> list[float]:
            return [value for each in self.reports for value in getattr(each.rejection, name).tolist()]

        channels = [each.channel for each in self.reports for _ in each.rejection.frequency_hz]
        confidence_db = over_all("confidence_db")
        return [
            Column("channel", channels, "channel"),
            Column("frequency_hz", over_all("frequency_hz"), "frequency (Hz)"),
            Column("measured_db", over_all("measured_db"), "with the loop over without (dB)", ".2f", confidence_db),
            Column("confidence_db", confidence_db),
            Column("expected_db", over_all("expected_db"), "expected (dB)", ".2f"),
        ]

    def chart(self) -> Chart:
        curves = []
        for number, each in enumerate(self.reports):
            rejection = each.rejection
            hertz, half = rejection.frequency_hz, rejection.confidence_db
            words = "what its model expects" if number == 0 else ""
            curves += [
                ChartLine(f"{each.channel}, ± 95 %", hertz, rejection.measured_db, "o", half, colour=number),
                ChartLine(words, hertz, rejection.expected_db, "--", colour=number),
            ]
        return Chart("frequency (Hz)", "motion with the loop over without (dB)", curves, True, limits={"no loop": 0.0})

    def tables(self) -> Sequence[ResultTable | str]:
        rows: list[tuple[str, ...]] = []
        for each in self.reports:
            unit, press, tremor = each.unit, each.press, each.tremor
            settled = f"{press.peak_mm:.3g} {unit}, within a tenth after {press.recovery_s:.2f} s"
            rows += [
                (each.channel, "press", settled, f"{press.without_loop_mm:.3g} {unit} without the loop"),
                (each.channel, "lift", f"{press.lift_peak_mm:.3g} {unit}", ""),
                (each.channel, "tremor 4–12 Hz", f"{tremor.rejection_db:.2f} dB", f"{tremor.expected_db:.2f} dB"),
            ]
        disturbances = ResultTable("", ("channel", "disturbance", "measured", "expected"), tuple(rows))
        return [text_table(self.table()), disturbances]


def measure_rejection(
    rig: RigOption,
    controller: ControllerOption = None,
    *,
    display: DisplayOption = None,
    channel: Channels = None,
    frequency_hz: Annotated[
        Numbers, Option("Frequencies, with commas.", type=str, shell=_listed(REJECTION_HZ))
    ] = REJECTION_HZ,
    excursion_mm: Annotated[float, Option("Movement by each force without the loop.")] = EXCURSION_MM,
    seed: Seed = 0,
) -> DisturbanceResult:
    """Test how presses and tremor are rejected. Forces act at the finger port.

    Raises BadInput for a rig without a finger port, and for a loop that is unstable by the display's models.

    >>> tt.measure_rejection(rig, controller, channel=["index"], frequency_hz=[5.0]).columns()["channel"]
    ['index']
    """
    loop = chosen_controller(display, controller)
    require_stable(loop)
    reports = []
    with opened(rig, loop.display, seed) as ready:
        ready.load(loop)
        rng, wanted = np.random.default_rng(seed), numbers(frequency_hz, "frequency_hz")
        how = {"excursion_mm": excursion_mm, "mains_hz": loop.display.mains_hz(None, MAINS_HZ)}
        for name in channel or [each.name for each in loop.channels]:
            with working(f"disturbing {name}"):
                reports.append(disturbance(ready, loop, name, wanted, rng, **how))
    return DisturbanceResult(tuple(reports))


@dataclass(frozen=True, eq=False, repr=False)
class FingerResult(Result):
    """Mass, damping and stiffness of what touches each channel."""

    estimates: tuple[FingerEstimate, ...]

    @property
    def holds(self) -> bool:
        return all(estimate.described_by == ONE for estimate in self.estimates)

    def facts(self) -> Sequence[Fact]:
        words = [
            found(e.channel, f"mass {e.mass:.4g}, damping {e.damping:.4g}, stiffness {e.stiffness:.4g}: {_said(e)}")
            for e in self.estimates
        ]
        return [Fact("channels", [vars(estimate) for estimate in self.estimates]), *words]

    def table(self) -> Sequence[Column]:
        impedance = (
            Column(
                name,
                [getattr(estimate, name) for estimate in self.estimates],
                name,
                half=[estimate.half_width[place] for estimate in self.estimates],
            )
            for place, name in enumerate(("mass", "damping", "stiffness"))
        )
        return [
            Column("channel", [estimate.channel for estimate in self.estimates], "channel"),
            *impedance,
            Column("misfit_db", [estimate.misfit_db for estimate in self.estimates], "misfit dB", ".2f"),
            Column("described_by", list(map(_said, self.estimates)), "described by"),
        ]

    def tables(self) -> Sequence[ResultTable | str]:
        note = (
            "in the units of a load of the display file, ± 95 %; misfit: greatest error of the felt level if "
            "the load is taken as one mass, damper and spring"
        )
        lines = [
            f'{estimate.channel}: loads = [{{ name = "finger", mass = {estimate.load.mass:.4g}, damping = '
            f"{estimate.load.damping:.4g}, stiffness = {estimate.load.stiffness:.4g}"
            f"{f', per = {estimate.per:.6g}' if estimate.per else ''} }}]"
            for estimate in self.estimates
            if estimate.described_by == ONE
        ]
        return [text_table(self.table(), notes=[note]), *lines]


def _said(estimate: FingerEstimate) -> str:
    if estimate.saturated:
        return "cannot tell: the sensor clipped; lower the level"
    return {
        ONE: "one mass, damper and spring",
        CHAIN: "a chain of two masses fits better than one",
        NEITHER: "neither one mass nor a chain of two fits",
        CANNOT_TELL: "cannot tell: play longer or at a higher level",
    }[estimate.described_by]


def estimate_load(
    rig: RigOption,
    controller: ControllerOption = None,
    *,
    display: DisplayOption = None,
    load: Annotated[
        str | None, Option("Load of the display file that touches (default: finger, or the first).")
    ] = None,
    level_db_sl: Annotated[float, Option("Level of each line, dB SL (-60..55).", _LEVEL)] = FINGER_LEVEL_DB_SL,
    duration_s: Annotated[float, Option("Seconds played, a little less than half of them free.")] = FINGER_S,
    channel: Channels = None,
    seed: Seed = 0,
) -> FingerResult:
    """Estimate the impedance of the touching finger. A signal is played free, touched and free again; `holds` is False
    if one mass, damper and spring does not describe the finger.

    Raises BadInput for a load that the display does not have.

    >>> tt.estimate_load(tt.SimulatedRig(controller.display, seed=1), controller, duration_s=28.0).columns()["channel"]
    ['index', 'thumb', 'middle']
    """
    loop = chosen_controller(display, controller)
    touching = load or usual_load(loop.display.channels)
    require_stable(loop, touching)
    with opened(rig, loop.display, seed) as ready, working("playing free, touched, free again"):

        def touch(on: bool) -> None:
            if on:
                put_on(ready, loop, touching)
            elif ready.has_finger_ports:
                for name in ready.channels:
                    ready.finger(name).touch(None)
            else:
                say(f"take the load {touching!r} off by hand now")
                ready.play(np.zeros((round(_LIFTED_S * ready.rate_hz), len(ready.channels))))

        estimates = measure_finger(
            ready,
            loop,
            touch,
            np.random.default_rng(seed),
            channels=channel,
            level_db_sl=level_db_sl,
            seconds=duration_s,
        )
    return FingerResult(tuple(estimates))
