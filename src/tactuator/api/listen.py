"""Live sound on fingers: `listen`."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from os import PathLike
from typing import Annotated

from tactuator.api.option import Option, option_of
from tactuator.api.parameters import ControllerOption, DisplayOption, Place, RigOption, Seed, chosen_controller, opened
from tactuator.api.progress import working
from tactuator.api.speech import CODING_HELP, wishes
from tactuator.errors import BadInput
from tactuator.model.controller import Controller
from tactuator.result import Fact, Result, ResultTable, data, found
from tactuator.rig.rig import Rig
from tactuator.rig.simulated import PacedRig
from tactuator.rig.sound.rig import SoundRig
from tactuator.speech.coding import coding_of, live_coding
from tactuator.speech.live.level import LevelSettings
from tactuator.speech.live.run import fed_shortly, run_live
from tactuator.speech.live.source import Source, open_source
from tactuator.speech.live.stream import LiveState, LiveStream
from tactuator.speech.options import CODING


@dataclass(frozen=True, eq=False, repr=False)
class ListenResult(Result):
    """What a live stream was. delays_s: by stage. coding_delays_s: by the frequency that is felt, hertz."""

    rig: str
    state: LiveState
    stopped: bool
    delays_s: dict[str, float]
    coding_delays_s: dict[float, float]
    notes: tuple[str, ...]

    @property
    def ending(self) -> BaseException | None:
        return KeyboardInterrupt() if self.stopped else None

    def notices(self) -> Sequence[str]:
        return self.notes

    def facts(self) -> Sequence[Fact]:
        state = self.state
        least_s, most_s = (f(self.coding_delays_s.values(), default=0.0) for f in (min, max))
        fixed_s = sum(self.delays_s.values())
        return [
            found("played", state.seconds, "s", ".2f"),
            found("delay", f"{1e3 * (fixed_s + least_s):.1f} to {1e3 * (fixed_s + most_s):.1f} ms, by frequency"),
            found("drop-outs", state.dropouts),
            found("buffer off its length by up to", 1e3 * state.worst_s, "ms", ".2f"),
            found("limiter", f"up to {state.taken_back_db:.1f} dB, for {state.taken_back_s:.2f} s"),
            *([found("samples that were no numbers", state.not_numbers)] if state.not_numbers else []),
            *data({"rig": self.rig, "stopped": self.stopped, "delays_s": self.delays_s, **asdict(state)}),
            Fact("coding_delays_s", {f"{hertz:g}": late_s for hertz, late_s in self.coding_delays_s.items()}),
        ]

    def tables(self) -> Sequence[ResultTable | str]:
        rows = [(stage, f"{1e3 * late_s:.2f}") for stage, late_s in self.delays_s.items()]
        coding = self.coding_delays_s.items()
        rows += [(f"coding, felt at {hertz:.0f} Hz", f"{1e3 * late_s:.2f}") for hertz, late_s in coding]
        return [ResultTable("Delay", ("stage", "ms"), tuple(rows))]


def listen(
    rig: RigOption,
    controller: ControllerOption,
    input: Annotated[
        Place | Source | None,
        Option("Microphone[@RATE], - (standard input), or a sound file (default: the system's microphone).", type=str),
    ] = None,
    *,
    display: DisplayOption = None,
    coding: Annotated[str, Option(CODING_HELP)] = CODING,
    level_db_sl: Annotated[float, option_of(LevelSettings, "level_db_sl", "--level")] = LevelSettings.level_db_sl,
    gain_db: Annotated[float | None, option_of(LevelSettings, "gain_db", "--gain")] = None,
    attack_s: Annotated[float, option_of(LevelSettings, "attack_s")] = LevelSettings.attack_s,
    release_s: Annotated[float, option_of(LevelSettings, "release_s")] = LevelSettings.release_s,
    range_db: Annotated[float, option_of(LevelSettings, "range_db")] = LevelSettings.range_db,
    gate_db: Annotated[float, option_of(LevelSettings, "gate_db", "--gate")] = LevelSettings.gate_db,
    rate_hz: Annotated[int | None, Option("Of raw samples on standard input, Hz.", ("--rate",))] = None,
    fast: Annotated[bool, Option("Simulated, a file: as fast as it computes, not in real time.")] = False,
    seed: Seed = 0,
    report: Callable[[LiveState, Callable[[], None]], None] | None = None,
) -> ListenResult:
    """Let fingers feel sound as it comes. Space mutes; q or Ctrl-C stops.

    The display comes to rest however it ends. report: called with the state 20 times a second, and with a function
    that stops. Raises BadInput for what is no sound, and for a coding that cannot be causal.

    >>> tt.listen(rig, controller, "speech.wav", fast=True).state.dropouts
    0
    """
    settings = LevelSettings(level_db_sl, gain_db, attack_s, release_s, range_db, gate_db)
    chosen = live_coding(coding_of(coding))
    if fast and not isinstance(rig, Rig) and rig not in ("simulated", "in-process"):
        raise BadInput(f"--fast at {rig}", "a rig whose time waits: simulated, in-process")
    named: Source = open_source(input, rate_hz) if input is None or isinstance(input, str | PathLike) else input
    with closing(named) as source:
        loaded = chosen_controller(display, controller)
        with (
            opened(rig, loaded.display, seed) as ready,
            fed_shortly(ready),
            wishes() as wish,
            working("listen") as step,
        ):
            ready.load(loaded)
            if isinstance(ready, SoundRig):
                ready.allow_gaps = True  # counted, and felt as the gaps that they are
            paced = ready if fast or not ready.waits else PacedRig(ready)
            clock = None if ready.waits and paced is ready else time.monotonic
            stream = LiveStream(source, loaded, chosen, settings, clock)

            def each(state: LiveState) -> None:
                wanted = wish()
                stream.muted = wanted == "pause"
                if wanted == "stop":
                    stream.stop()
                step(text=_line(state))
                if report is not None:
                    report(state, stream.stop)

            run_live(stream, paced, source, each)
            delays_s = stream.delays() | {"rig": ready.lead_s + _late(loaded)}
    name = rig if isinstance(rig, str) else type(rig).__name__
    return ListenResult(name, stream.state, stream.stopped, delays_s, dict(stream.coding_delays), source.notes)


def _late(controller: Controller) -> float:
    """Return the delay of the display's converters or card, seconds."""
    display = controller.display
    card = 0 if display.sound is None else display.sound.latency_samples
    return (card + controller.delay_samples) / controller.rate_hz


def _line(state: LiveState) -> str:
    levels = ", ".join(f"{name} {max(level, 0.0):.0f}" for name, level in state.level_db_sl.items())
    return f"{levels} dB SL; {state.dropouts} drop-outs"
