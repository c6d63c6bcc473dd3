"""Speech, clips and alignments on fingers: render, play."""

import select
import signal
import sys
import termios
import threading
import tty
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

from tactuator import report
from tactuator.api.items import LAYOUT_HELP
from tactuator.api.option import Argument, Option
from tactuator.api.parameters import (
    ControllerOption,
    DisplayOption,
    Figures,
    Place,
    RigOption,
    Seed,
    chosen_controller,
    opened,
)
from tactuator.api.progress import working
from tactuator.errors import BadInput
from tactuator.io.reference import open_reference
from tactuator.perception.curve import COMFORT_DB_SL
from tactuator.result import Chart, ChartLine, Column, Fact, Result, ResultTable, columns_of, data, found
from tactuator.rig.player import Played, Wish, play_reference
from tactuator.rig.simulated import PacedRig
from tactuator.rig.sound.rig import SoundRig
from tactuator.speech.coding import coding_of, write_coding
from tactuator.speech.folder import RenderedFolder, render_folder, workers_of
from tactuator.speech.options import CODING, LEVEL_DB_SL
from tactuator.speech.reading import scan_speech, sentence_path
from tactuator.speech.render import Rendered, RenderJob, kind_of_source, render_file
from tactuator.speech.taps import read_layout

CODING_HELP = "Of speech: direct, bands, envelope, yuan-2005, bratakos-2001, or FILE.toml."
MOST_LOSS_DB = 3.0


@dataclass(frozen=True, eq=False, repr=False)
class RenderResult(Result):
    """A source as a reference in dB SL. path: of the reference. most_loss_db: the shortfall up to which it holds."""

    path: Path
    source: Path
    rendered: Rendered
    most_loss_db: float

    @property
    def holds(self) -> bool:
        loss = self.rendered.loss
        return loss is None or loss.shortfall_db_sl <= self.most_loss_db

    def facts(self) -> Sequence[Fact]:
        loss, duration_s = self.rendered.loss, self.rendered.duration_s
        facts = [
            Fact("out", self.path, "reference", summary=True),
            Fact("source", self.source),
            found("duration", duration_s, "s"),
        ]
        if loss is not None:
            facts += [
                found("short by up to", f"{loss.shortfall_db_sl:.3g} dB (allowed: {self.most_loss_db:g})"),
                found("the display's limits take back", f"{loss.clipped_s:.2f} s of {duration_s:.2f} s"),
                found("frequencies moved into the band, by up to", loss.frequency_shift_jnd, "JND", ".1f"),
            ]
            if loss.emphasis_rise_db is not None:
                rise = "{:.1f}, {:.1f} dB".format(*loss.emphasis_rise_db)
                facts.append(found("taps rise above what is beneath, asked and delivered", rise))
        peaks = [found(name, level, "dB SL at the peak") for name, level in self.rendered.peak_db_sl.items()]
        return [*facts, *peaks, *data(self.rendered.document()), Fact("met", self.holds)]

    def next_step(self) -> str:
        return f"tactuator play {self.path}, with the controller"

    def notices(self) -> Sequence[str]:
        return self.rendered.notes

    def table(self) -> Sequence[Column]:
        loss = self.rendered.loss
        if loss is None:
            return columns_of(("finger", "peak_db_sl"), self.rendered.peak_db_sl.items())
        return [Column(name, getattr(loss, name)) for name in ("time_s", "asked_db_sl", "delivered_db_sl")]

    def chart(self) -> Chart:
        peaks, felt, loss = self.rendered.peak_db_sl, self.rendered.felt, self.rendered.loss
        if loss is not None:
            asked = ChartLine("asked", loss.time_s, loss.asked_db_sl, colour=0)
            given = ChartLine("delivered", loss.time_s, loss.delivered_db_sl, "--", colour=1)
            return Chart("time (s)", "level (dB SL)", [asked, given], limits={"threshold": 0.0})
        if felt is None:
            curves = [ChartLine("peak", list(peaks), list(peaks.values()), "o")]
            return Chart("finger", "level (dB SL)", curves, limits={"comfort": COMFORT_DB_SL, "threshold": 0.0})
        curves = []
        for number, finger in enumerate(felt.fingers):
            hertz, words = finger.centre_hz, "felt" if number == 0 else ""
            curves += [
                ChartLine(f"{finger.finger}, asked", hertz, finger.asked_db_sl, colour=number),
                ChartLine(words, hertz, finger.felt_db_sl, "o", colour=number),
            ]
        return Chart("frequency (Hz)", "band level (dB SL)", curves, log_x=True, limits={"threshold": 0.0})

    def tables(self) -> Sequence[ResultTable | str]:
        felt: dict[str, Any] = {} if self.rendered.felt is None else self.rendered.felt.figures()
        rows = []
        for entry in self.rendered.limiting:
            figures, names = felt.get(entry.finger), ("rms_db", "median_db_all", "p95_db_all")
            cells = ["–"] * 3 if figures is None else [f"{figures[name]:.2f} dB" for name in names]
            rows.append((entry.finger, f"{self.rendered.peak_db_sl[entry.finger]:.1f}", _limited(entry), *cells))
        columns = ("finger", "peak dB SL", "limiter", "felt − asked, rms", "median frame", "95 % of frames")
        return [ResultTable("Reference", columns, tuple(rows))]


def _limited(entry: Any) -> str:
    if entry.max_reduction_db == 0.0:
        return "not needed"
    reason = max(entry.reasons, key=entry.reasons.get)
    return f"up to {entry.max_reduction_db:.1f} dB for {entry.reduced_s:.2f} s ({reason})"


@dataclass(frozen=True, eq=False, repr=False)
class FolderResult(Result):
    """A folder as references. most_loss_db: the shortfall of each clip up to which it holds."""

    path: Path
    folder: RenderedFolder
    most_loss_db: float

    def _short(self) -> list[str]:
        lost = [(each["out"], (each["loss"] or {}).get("shortfall_db_sl", 0.0)) for each in self.folder.files]
        return [f"{name}: short by {loss:.1f} dB SL" for name, loss in lost if loss > self.most_loss_db]

    @property
    def holds(self) -> bool:
        return not (self.folder.failures or self._short())

    def notices(self) -> Sequence[str]:
        endings = Counter(Path(name).suffix or Path(name).name for name in self.folder.left_out)
        listed = ", ".join(f"{count} {ending}" for ending, count in endings.most_common())
        return [f"left out, since they are no source: {listed}"] if listed else []

    def facts(self) -> Sequence[Fact]:
        kept, short = sum(each["kept"] for each in self.folder.files), self._short()
        duration_s = sum(each["duration_s"] for each in self.folder.files)
        return [
            Fact("out", self.path, "folder", summary=True),
            found("rendered", len(self.folder.files) - kept),
            found("kept from an earlier run", kept),
            found("failed", len(self.folder.failures)),
            found("short", len(short)),
            found("left out", len(self.folder.left_out)),
            *data({"duration_s": duration_s, **vars(self.folder), "met": self.holds}),
        ]

    def tables(self) -> Sequence[ResultTable | str]:
        return [*(f"failed: {failure['error']}" for failure in self.folder.failures), *self._short()]


def speech_source(path: Place | None) -> Path:
    """Return a file of speech, read through, or the shipped sentence. Raises BadInput for what cannot be rendered."""
    return scan_speech(sentence_path() if path is None else Path(path)).path


def render(
    source: Annotated[
        Place,
        Argument("Speech (WAV, FLAC, ...), clip (.haptic, .ahap), alignment (.TextGrid); or a folder.", file=True),
    ],
    controller: ControllerOption,
    out: Annotated[
        Place, Option("Reference to write: .wav (with NAME.json) or .h5; of a folder, one.", writes="reference")
    ],
    coding: Annotated[str, Option(CODING_HELP)] = CODING,
    level_db_sl: Annotated[
        float, Option("Of an utterance, a clip's strength 1, a burst; dB SL.", ("--level",))
    ] = LEVEL_DB_SL,
    *,
    display: DisplayOption = None,
    felt: Annotated[
        Place | None, Option("File for what the simulated display's fingers feel.", writes="reference")
    ] = None,
    figures: Figures = None,
    save_coding: Annotated[
        Place | None, Option("TOML file for the coding, with every parameter.", writes="coding")
    ] = None,
    seed: Seed = 0,
    most_loss_db: Annotated[float, Option("Of a clip: greatest shortfall, dB.", ("--most-loss",), ge=0)] = MOST_LOSS_DB,
    legacy: Annotated[
        bool, Option("Take a .haptic whose frequency outlasts its amplitude, as older players do.")
    ] = False,
    live: Annotated[bool, Option("Of speech: as `listen` makes it of the same sound.")] = False,
    layout: Annotated[Place | None, Option(LAYOUT_HELP, file=True)] = None,
    workers: Annotated[int | None, Option("Of a folder: processes (default: cores).", ge=1)] = None,
    scheduler: Annotated[str | None, Option("Of a folder: address of a Dask scheduler.")] = None,
) -> RenderResult | FolderResult:
    """Render speech, clips or phonemes to a reference in dB SL. The display's limits are kept. Of a folder, every file
    is rendered that an earlier run did not finish.

    A clip holds where the display falls short by no more than `most_loss_db`, a folder where every file does. Raises
    BadInput for what is no source, another coding, or a display without the coding's fingers.

    >>> tt.render("speech.wav", controller, "reference.wav").path.name
    'reference.wav'
    """
    place, target = Path(source), Path(out)
    kind = "folder" if place.is_dir() else kind_of_source(place)
    given = {"coding": coding != CODING, "save_coding": save_coding, "legacy": legacy, "live": live,
             "layout": layout, "felt": felt, "figures": figures, "workers": workers,
             "scheduler": scheduler}  # fmt: skip
    _require_fitting(source, kind, {name: value for name, value in given.items() if value})
    chosen, loaded = coding_of(coding), chosen_controller(display, controller)
    channels = [channel.name for channel in loaded.display.channels]
    placed = None if layout is None else read_layout(Path(layout), channels)
    job = RenderJob(loaded, chosen, level_db_sl, felt is not None, seed, placed, legacy, live)
    result: RenderResult | FolderResult
    if kind == "folder":
        result = _folder(place, target, job, most_loss_db, workers, scheduler)
    else:
        with working("render", 1.0) as step:
            rendered = render_file(place, target, job, None if felt is None else Path(felt), step)
        result = RenderResult(target, place, rendered, most_loss_db)
        if figures is not None:
            _draw(result, Path(figures), f"{place.name}, coding “{coding}” at {level_db_sl:g} dB SL")
    if save_coding is not None:
        write_coding(Path(save_coding), chosen)
    return result


def _require_fitting(source: Place, kind: str, given: Mapping[str, Any]) -> None:
    """Raise BadInput for options that are not for a source of that kind, or contradict each other."""
    for name in given:
        if kind not in _TAKEN_BY[name]:
            raise BadInput(f"`{name}` with {source} ({kind})", " or ".join(_TAKEN_BY[name]))
    if {"workers", "scheduler"} <= given.keys():
        raise BadInput("`workers` with `scheduler`", "one of them, since a cluster has its own")
    if kind == "speech" and "figures" in given and "felt" not in given:
        raise BadInput("`figures` without `felt`", "both, since they show what was felt")


_TAKEN_BY: Mapping[str, tuple[str, ...]] = {
    "coding": ("speech", "folder"), "save_coding": ("speech", "folder"),
    "live": ("speech", "folder"), "legacy": ("clip", "folder"),
    "layout": ("alignment", "folder"), "felt": ("speech", "clip", "alignment"),
    "figures": ("speech", "clip", "alignment"), "workers": ("folder",), "scheduler": ("folder",),
}  # fmt: skip
"""Kinds of sources that an option is for."""


def _folder(
    folder: Path, out: Path, job: RenderJob, most_loss_db: float, workers: int | None, scheduler: str | None
) -> FolderResult:
    with workers_of(workers, scheduler) as doers, working("render") as step:
        return FolderResult(out, render_folder(folder, out, job, doers, step), most_loss_db)


def _draw(result: RenderResult, folder: Path, caption: str) -> None:
    felt = result.rendered.felt
    figure = (
        report.chart.chart_figure(result.chart(), result.source.stem)
        if felt is None
        else report.felt_figures.spectrogram_figure(felt, caption)
    )
    report.figure.save_figures([figure], folder)


@dataclass(frozen=True, eq=False, repr=False)
class PlayedResult(Result):
    """A reference that was played: its length, and how much of it was played or limited. gaps: of a sound card."""

    reference: Path
    rig: str
    played: Played
    gaps: int | None = None

    def notices(self) -> Sequence[str]:
        return (f"the sound card reported {self.gaps} gaps",) if self.gaps else ()

    @property
    def ending(self) -> BaseException | None:
        """Return an interruption where a person stopped it."""
        return KeyboardInterrupt() if self.played.stopped else None

    def facts(self) -> Sequence[Fact]:
        played = self.played
        words = {"length": "duration_s", "played": "played_s", "paused": "paused_s", "at a limit": "saturated_s"}
        times = {name: word for word, name in words.items()}
        return [
            *data({"reference": self.reference, "rig": self.rig}),
            *(
                Fact(name, value, times.get(name, ""), "s", ".2f", name in times)
                for name, value in asdict(played).items()
            ),
            *([] if self.gaps is None else [Fact("gaps", self.gaps)]),
        ]


def play(
    rig: RigOption,
    controller: ControllerOption,
    reference: Annotated[Place, Argument("Reference that `render` wrote: .wav or .h5.", file=True)],
    *,
    display: DisplayOption = None,
    realtime: Annotated[bool, Option("Play in real time.")] = False,
    seed: Seed = 0,
) -> PlayedResult:
    """Play a reference. Space pauses and resumes; q or Ctrl-C stops.

    Raises BadInput for a file that is no reference, or not for this display.

    >>> tt.play(rig, controller, "protocols/a.wav")
    <Played length: 0.50 s, played: 0.50 s, paused: 0.00 s, at a limit: 0.00 s>
    """
    source = open_reference(Path(reference))
    loaded = chosen_controller(display, controller)
    with opened(rig, loaded.display, seed) as ready, wishes() as wish, working("play", source.duration_s) as step:
        ready.load(loaded)
        if isinstance(ready, SoundRig):
            ready.allow_gaps = True  # the listener notices a gap; it is counted and reported
        played = play_reference(PacedRig(ready) if realtime else ready, source, wish, step)
        gaps = ready.gaps if isinstance(ready, SoundRig) else None
    return PlayedResult(Path(reference), rig if isinstance(rig, str) else type(rig).__name__, played, gaps)


@contextmanager
def wishes() -> Iterator[Callable[[], Wish]]:
    """Yield a function that returns the request of the person at the keyboard; Ctrl-C and SIGTERM request a stop."""
    if threading.current_thread() is not threading.main_thread():  # signals are the main thread's
        yield lambda: "run"
        return
    state: dict[str, Wish] = {"wish": "run"}

    def stop(number: int, frame: FrameType | None) -> None:
        state["wish"] = "stop"

    def wish() -> Wish:
        if state["wish"] != "stop" and sys.stdin.isatty() and select.select([sys.stdin], [], [], 0.0)[0]:
            key = sys.stdin.read(1)
            if key == " ":
                state["wish"] = "pause" if state["wish"] == "run" else "run"
            elif key in ("q", ""):
                state["wish"] = "stop"
        return state["wish"]

    former = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        with _keys_at_once():
            yield wish
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


@contextmanager
def _keys_at_once() -> Iterator[None]:
    if not sys.stdin.isatty():
        yield
        return
    settings = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)
