"""Live sound on fingers: `listen`."""

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass
from functools import partial, wraps
from os import PathLike
from typing import Annotated, Any, Self

from tactuator.api.option import Option, option_of
from tactuator.api.parameters import ControllerOption, DisplayOption, Place, RigOption, Seed, chosen_controller, opened
from tactuator.api.progress import working
from tactuator.api.speech import CODING_HELP, wishes
from tactuator.errors import BadInput
from tactuator.result import Fact, Result, ResultTable, data, found
from tactuator.rig.rig import Rig, Trace
from tactuator.rig.simulated import PacedRig
from tactuator.speech.coding import LiveCoding, coding_of, live_coding
from tactuator.speech.live.level import LevelSettings
from tactuator.speech.live.meter import LiveBlock, LiveMeter
from tactuator.speech.live.run import fed_shortly, prompt, run_live
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
            *([found("rig missed its time", state.missed)] if state.missed else []),
            *([found("buffer off its length by up to", 1e3 * state.worst_s, "ms", ".2f")] if state.worst_s else []),
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


_LOOK_S = 0.05


@dataclass(frozen=True)
class _Ready:
    """A live stream that may begin, on a rig that is loaded."""

    stream: LiveStream
    rig: Rig
    source: Source
    meter: LiveMeter


class Listening:
    """Live sound on a display, which plays beside the body of a `with` statement; `run` waits until it ends.

    block: the newest one; None before the first. result: what the stream was, once the body has been left.
    """

    result: ListenResult

    def __init__(
        self,
        opening: Callable[[], AbstractContextManager[_Ready]],
        name: str,
        on_block: Callable[[LiveBlock], None] | None,
    ) -> None:
        self._opening, self._name, self._on_block = opening, name, on_block
        self._stack = ExitStack()
        self.block: LiveBlock | None = None

    def __enter__(self) -> Self:
        self._ready = self._stack.enter_context(self._opening())
        stream, rig, source = self._ready.stream, self._ready.rig, self._ready.source
        beside = self._stack.enter_context(ThreadPoolExecutor(1))
        self._playing = beside.submit(run_live, stream, rig, source, self._report)
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        with self._stack:
            if not self._playing.done():
                self.stop()
            futures.wait([self._playing])
            stream, source, delays_s = self._ready.stream, self._ready.source, self._ready.meter.delays()
            coding_delays_s = dict(stream.coding_delays)
            self.result = ListenResult(
                self._name, stream.state, stream.stopped, delays_s, coding_delays_s, source.notes
            )
        if error is None:
            self._playing.result()

    @property
    def muted(self) -> bool:
        """Whether nothing is felt for now; it fades within 20 ms of being set."""
        return self._ready.stream.muted

    @muted.setter
    def muted(self, muted: bool) -> None:
        self._ready.stream.muted = muted

    def stop(self) -> None:
        """Fade out, and end."""
        self._ready.stream.stop()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until the sound ends, and return whether it has. Raises what ended it: of the callback, or a fault."""
        over, _ = futures.wait([self._playing], timeout_s)
        for each in over:
            each.result()
        return bool(over)

    def run(self) -> ListenResult:
        """Play until the sound ends, or the keys or Ctrl-C stop it."""
        with self, prompt(), wishes() as wish, working("listen") as step:
            while not self.wait(_LOOK_S):
                wanted = wish()
                self.muted = wanted == "pause"
                if wanted == "stop":
                    self.stop()
                step(text=_line(self._ready.stream.state))
        return self.result

    def _report(self, trace: Trace) -> None:
        for block in self._ready.meter.push(trace):
            self.block = block
            if self._on_block is not None:
                self._on_block(block)


@contextmanager
def _opened(
    rig: Rig | str, controller: Any, display: Any, input: Any, rate_hz: int | None,
    coding: LiveCoding, level: LevelSettings, fast: bool, seed: int,
) -> Iterator[_Ready]:  # fmt: skip
    named: Source = open_source(input, rate_hz) if input is None or isinstance(input, str | PathLike) else input
    with closing(named) as source:
        loaded = chosen_controller(display, controller)
        with opened(rig, loaded.display, seed) as ready, fed_shortly(ready):
            ready.load(loaded)
            paced = ready if fast or not ready.waits else PacedRig(ready)
            clock = None if ready.waits and paced is ready else time.monotonic
            stream = LiveStream(source, loaded, coding, level, clock)
            yield _Ready(stream, paced, source, LiveMeter(stream, ready))


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
    on_block: Callable[[LiveBlock], None] | None = None,
) -> Listening:
    """Let fingers feel sound as it comes. Space mutes; q or Ctrl-C stops.

    In a `with` statement it plays beside the body; `.run()` waits until it ends. The display comes to rest however
    either is left, by an exception in the callback too.

    Parameters
    ----------
    on_block: called 20 times a second with time, felt and asked dB SL by finger, delay and drop-outs (`LiveBlock`).

    >>> felt = []
    >>> with tt.listen(rig, controller, "speech.wav", fast=True, on_block=felt.append) as live:
    ...     live.wait()
    True
    >>> max(block.felt_db_sl["index"] for block in felt) > 20.0
    True
    """
    level = LevelSettings(level_db_sl, gain_db, attack_s, release_s, range_db, gate_db)
    chosen = live_coding(coding_of(coding))
    if fast and not isinstance(rig, Rig) and rig not in ("simulated", "in-process"):
        raise BadInput(f"`fast` at {rig}", "a rig whose time waits: simulated, in-process")
    name = rig if isinstance(rig, str) else type(rig).__name__
    opening = partial(_opened, rig, controller, display, input, rate_hz, chosen, level, fast, seed)
    return Listening(opening, name, on_block)


@wraps(listen)
def listen_until_it_ends(*given: Any, **named: Any) -> ListenResult:  # noqa: D103
    return listen(*given, **named).run()


def _line(state: LiveState) -> str:
    levels = ", ".join(f"{name} {max(level, 0.0):.0f}" for name, level in state.level_db_sl.items())
    return f"{levels} dB SL; {state.dropouts + state.missed} drop-outs"
