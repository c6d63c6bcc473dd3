"""The verbs that bring speech to fingers: waveforms, render, play."""

import select
import signal
import string
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.errors import BadInput
from tactuator.speech.options import CODING, LEVEL_DB_SL
from tactuator.table import Chart, ChartLine, ResultTable
from tactuator.verbs.parameters import (
    Argument,
    ControllerOption,
    DisplayOption,
    Figures,
    Option,
    Place,
    RigOption,
    Seed,
    chosen_controller,
    opened,
)
from tactuator.verbs.pattern import LEGACY_HELP, MADE_FOR_HELP, MOST_LOSS_DB, ClipResult, render_pattern
from tactuator.verbs.result import Result, columns_of, figure, working

if TYPE_CHECKING:
    from tactuator.rig.player import Played, Wish
    from tactuator.speech.render import Rendered
    from tactuator.speech.waveforms import WrittenWaveform

PROTOCOL = "protocol.toml"
CODING_HELP = "direct, bands, envelope, yuan-2005, bratakos-2001, or FILE.toml."


@dataclass(frozen=True, eq=False, repr=False)
class WaveformsResult(Result):
    """Synthetic waveforms in a folder, and the protocol that asks for them."""

    out: Path
    waveforms: "tuple[WrittenWaveform, ...]"

    def to_dict(self) -> dict[str, Any]:
        items = [
            {"label": item.label, "file": item.path.name, "max_reduction_db": item.max_reduction_db}
            for item in self.waveforms
        ]
        return {"out": self.out, "protocol": self.out / PROTOCOL, "items": items}

    def tables(self) -> Sequence[ResultTable | str]:
        rows = tuple(
            (item.label, f"{item.max_reduction_db:.1f} dB" if item.max_reduction_db else "not needed")
            for item in self.waveforms
        )
        table = ResultTable("Waveforms", ("waveform", "limiter"), rows)
        return [table, f"written: {self.out}", f"written: {self.out / PROTOCOL}"]


def waveforms(
    out: Annotated[Place, Option("Folder for the references and protocol.toml.", type=Path)],
    controller: ControllerOption = None,
    *,
    display: DisplayOption = None,
    duration: Annotated[float, Option("Of every waveform, seconds.")] = 0.5,
    level: Annotated[float, Option("Of every component, dB SL.")] = 40.0,
    fingers: Annotated[str, Option("Groups: names with +, groups with commas.")] = "thumb,index,middle,all",
    repetitions: Annotated[int, Option("Of each item in the test.", ge=1)] = 10,
    seed: Seed = 0,
) -> WaveformsResult:
    """Write waveforms and a protocol that asks for them. They are kinesthetic, middle and cutaneous, singly and
    combined.

    Raises BadInput for a finger that the display does not have.

    >>> len(tt.waveforms("waves", controller, fingers="thumb").waveforms)
    7
    """
    from tactuator.io.atomic import atomic_folder, write_text
    from tactuator.speech.waveforms import CUTANEOUS, KINESTHETIC, MIDDLE, WaveformSet, write_waveforms

    loaded = chosen_controller(display, controller)
    groups = tuple(tuple(group.split("+")) for group in fingers.split(","))
    components = tuple(replace(component, level_db_sl=level) for component in (KINESTHETIC, MIDDLE, CUTANEOUS))
    waveform_set = WaveformSet(duration, components=components, fingers=groups)
    names = {f"{label}.{ending}" for label in waveform_set.labels() for ending in ("wav", "json")} | {PROTOCOL}
    with atomic_folder(out, frozenset(names)) as beside:
        with working("rendering waveforms"):
            written = write_waveforms(waveform_set, loaded, beside)
        items = [(item.label, item.path.name) for item in written]
        study = f"waveforms of {1e3 * duration:g} ms"
        write_text(beside / PROTOCOL, recognition_protocol(study, items, repetitions, seed))
    return WaveformsResult(Path(out), written)


def recognition_protocol(study: str, items: Sequence[tuple[str, str]], repetitions: int, seed: int) -> str:
    """Return the protocol of a recognition experiment over items: label and file of each."""
    keys = [*string.digits[1:], *string.ascii_lowercase, *string.ascii_uppercase]
    keys += [f"{number}" for number in range(10, 1000)]
    listed = "".join(
        f'\n[[item]]\nlabel = "{label}"\nfile = "{file}"\nkey = "{key}"\n'
        for (label, file), key in zip(items, keys, strict=False)
    )
    return (
        f'[study]\nname = "{study}"\nseed = {seed}\n\n'
        '[recognition]\nparadigm = "recognition"\nlead_s = 0.3\ngap_s = 0.3\n'
        f'{listed}\n[[block]]\nkind = "training"\nrepetitions = 2\nfeedback = true\n'
        f'\n[[block]]\nkind = "test"\nrepetitions = {repetitions}\nfeedback = false\n'
        '\n[[subject]]\ncode = "S1"\n'
    )


@dataclass(frozen=True, eq=False, repr=False)
class SpokenResult(Result):
    """Speech as a reference in dB SL. path: the reference that was written."""

    path: Path
    rendered: "Rendered"

    def headline(self) -> Mapping[str, str]:
        peaks = {name: figure(level, "dB SL at the peak") for name, level in self.rendered.peak_db_sl.items()}
        return {"reference": str(self.path), "duration": figure(self.rendered.speech.duration_s, "s"), **peaks}

    def to_dict(self) -> dict[str, Any]:
        return {"out": self.path, **self.rendered.document()}

    def columns(self) -> Mapping[str, Any]:
        return columns_of(("finger", "peak_db_sl"), self.rendered.peak_db_sl.items())

    def chart(self) -> Chart:
        from tactuator.perception.curve import COMFORT_DB_SL

        peaks, felt = self.rendered.peak_db_sl, self.rendered.felt
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
        notes = (f"note: {note}" for note in self.rendered.speech.notes)
        return [ResultTable("Reference", columns, tuple(rows)), *notes]


def _limited(entry: Any) -> str:
    if entry.max_reduction_db == 0.0:
        return "not needed"
    reason = max(entry.reasons, key=entry.reasons.get)
    return f"up to {entry.max_reduction_db:.1f} dB for {entry.reduced_s:.2f} s ({reason})"


def render(
    speech: Annotated[Place, Argument("Speech: WAV, FLAC, ...; or a clip: .haptic, .ahap, .hjif, .xml.", file=True)],
    controller: ControllerOption,
    out: Annotated[Place, Option("Reference to write: .wav (with NAME.json) or .h5.", writes=True)],
    coding: Annotated[str, Option(CODING_HELP)] = CODING,
    level_db_sl: Annotated[
        float, Option("Of the utterance; of a clip's strength 1; dB SL.", ("--level",))
    ] = LEVEL_DB_SL,
    *,
    display: DisplayOption = None,
    felt: Annotated[Place | None, Option("What the simulated display's fingers feel, to write.", writes=True)] = None,
    figures: Figures = None,
    save_coding: Annotated[
        Place | None, Option("TOML to write: the coding, every parameter in it.", writes=True)
    ] = None,
    seed: Seed = 0,
    most_loss_db: Annotated[
        float, Option("Of a clip: shortfall that is allowed, dB.", ("--most-loss",), ge=0)
    ] = MOST_LOSS_DB,
    legacy: Annotated[bool, Option(LEGACY_HELP)] = False,
    made_for: Annotated[Place | None, Option(MADE_FOR_HELP, file=True)] = None,
) -> SpokenResult | ClipResult:
    """Code speech onto the fingers and write the reference. Its level is set in dB SL, and the display's limits are
    kept. A haptic clip (.haptic, .ahap, Android's .xml) is rendered as well, and its loss told.

    A clip holds where the display falls short by no more than `most_loss_db`. Raises BadInput for what is no speech and
    no clip, another coding, or a display without the coding's fingers.

    >>> tt.render("speech.wav", controller, "reference.wav").path.name
    'reference.wav'
    """
    from tactuator.patterns.files import is_clip
    from tactuator.speech.coding import coding_of, write_coding
    from tactuator.speech.render import RenderJob, render_file

    source = Path(speech)
    if is_clip(source):
        if coding != CODING or felt is not None or save_coding is not None:
            raise BadInput(
                f"{speech} is a clip: it has no coding, and is not felt by simulation", "--level, --most-loss"
            )
        folder = None if figures is None else Path(figures)
        loaded, device = chosen_controller(display, controller), None if made_for is None else Path(made_for)
        return render_pattern(source, loaded, Path(out), level_db_sl, most_loss_db, legacy, folder, device)
    if figures is not None and felt is None:
        raise BadInput("--figures without --felt", "both, since they show what was felt")
    chosen = coding_of(coding)
    job = RenderJob(chosen_controller(display, controller), chosen, level_db_sl, felt is not None, seed)
    with working("render", 1.0) as step:
        rendered = render_file(source, Path(out), job, None if felt is None else Path(felt), step)
    if save_coding is not None:
        write_coding(Path(save_coding), chosen)
    if figures is not None and rendered.felt is not None:
        from tactuator.report.felt import spectrogram_plate
        from tactuator.report.plate import save_plates

        plate = spectrogram_plate(rendered.felt, f"{source.name}, coding “{coding}” at {level_db_sl:g} dB SL")
        save_plates([plate], Path(figures))
    return SpokenResult(Path(out), rendered)


@dataclass(frozen=True, eq=False, repr=False)
class PlayedResult(Result):
    """A reference that was played: its length, and how much of it was played or limited. gaps: of a sound card."""

    reference: Path
    rig: str
    played: "Played"
    gaps: int | None = None

    def headline(self) -> Mapping[str, str]:
        played = self.played
        seconds = {"length": played.duration_s, "played": played.played_s, "saturated": played.saturated_s}
        return {name: f"{value:.2f} s" for name, value in seconds.items()}

    def notices(self) -> Sequence[str]:
        return (f"the sound card told of {self.gaps} gaps",) if self.gaps else ()

    @property
    def ending(self) -> BaseException | None:
        """Return an interruption where a person stopped it."""
        return KeyboardInterrupt() if self.played.stopped else None

    def to_dict(self) -> dict[str, Any]:
        gaps = {} if self.gaps is None else {"gaps": self.gaps}
        return {"reference": self.reference, "rig": self.rig, **asdict(self.played), **gaps}

    def tables(self) -> Sequence[ResultTable | str]:
        seconds = {
            "length": self.played.duration_s,
            "played": self.played.played_s,
            "paused": self.played.paused_s,
            "at a limit of a converter": self.played.saturated_s,
        }
        rows = tuple((words, f"{value:.2f}") for words, value in seconds.items())
        return [ResultTable(str(self.reference), ("what", "time (s)"), rows)]


def play(
    rig: RigOption,
    controller: ControllerOption,
    reference: Annotated[Place, Argument("Reference that `render` wrote: .wav or .h5.", file=True)],
    *,
    display: DisplayOption = None,
    realtime: Annotated[bool, Option("Keep time on a rig that could go faster.")] = False,
    seed: Seed = 0,
) -> PlayedResult:
    """Play a reference. Space pauses and goes on, q or Ctrl-C stops: that ramps down, and the rig comes to rest.

    Raises BadInput for a file that is no reference, or not for this display.

    >>> tt.play(rig, controller, "protocols/a.wav")
    <Played length: 0.50 s, played: 0.50 s, saturated: 0.00 s>
    """
    from tactuator.io.reference import open_reference
    from tactuator.rig.player import play_reference
    from tactuator.rig.sound.rig import SoundRig

    source = open_reference(Path(reference))
    loaded = chosen_controller(display, controller)
    with opened(rig, loaded.display, seed) as ready, _wishes() as wish, working("play", source.duration_s) as step:
        ready.load(loaded)
        if isinstance(ready, SoundRig):
            ready.allow_gaps = True  # a listener hears one; it is counted and told
        pace = _pace() if realtime else lambda played_s: None
        played = play_reference(ready, source, wish, step, pace)
        gaps = ready.gaps if isinstance(ready, SoundRig) else None
    return PlayedResult(Path(reference), rig if isinstance(rig, str) else type(rig).__name__, played, gaps)


def _pace() -> Callable[[float], None]:
    begun = time.monotonic()
    return lambda played_s: time.sleep(max(0.0, begun + played_s - time.monotonic()))


@contextmanager
def _wishes() -> "Iterator[Callable[[], Wish]]":
    """Yield a function that tells what the person at the keyboard wishes; Ctrl-C and SIGTERM are a wish to stop."""
    if threading.current_thread() is not threading.main_thread():  # signals are the main thread's
        yield lambda: "run"
        return
    state: dict[str, Wish] = {"wish": "run"}

    def stop(number: int, frame: FrameType | None) -> None:
        state["wish"] = "stop"

    def wish() -> "Wish":
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
    import termios  # there is none on Windows
    import tty

    settings = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)
