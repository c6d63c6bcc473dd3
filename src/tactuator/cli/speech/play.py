"""The verb `play`: a reference on a rig."""

from __future__ import annotations

import select
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from types import FrameType

from rich.table import Table

from tactuator.cli.answer import answer, progress
from tactuator.cli.chosen import chosen_controller
from tactuator.io.reference import open_reference
from tactuator.rig.open import open_rig
from tactuator.rig.player import Played, Wish, play_reference
from tactuator.rig.sound.rig import SoundRig


def run(
    reference: Path,
    display: Path | None,
    controller: Path | None,
    rig: str,
    realtime: bool,
    seed: int,
    as_json: bool,
) -> None:
    """Play a reference. Space pauses and goes on, q or Ctrl-C stops: that ramps down, and the rig comes to rest."""
    opened = open_reference(reference)
    chosen = chosen_controller(display, controller)
    with open_rig(rig, chosen.display, seed) as ready, _wishes() as wish, progress() as bars:
        ready.load(chosen)
        if isinstance(ready, SoundRig):
            ready.allow_gaps = True  # a listener hears one; it is counted and told
        task = bars.add_task("play", total=opened.duration_s)
        pace = _pace() if realtime else lambda played_s: None
        played = play_reference(ready, opened, wish, lambda done: bars.update(task, completed=done), pace)
        gaps = {"gaps": ready.gaps} if isinstance(ready, SoundRig) else {}
    if gaps.get("gaps"):
        sys.stderr.write(f"tactuator: the sound card told of {gaps['gaps']} gaps\n")
    answer({"reference": str(reference), "rig": rig, **asdict(played), **gaps}, as_json, _shown(played, reference))
    if played.stopped:
        raise KeyboardInterrupt


def _pace() -> Callable[[float], None]:
    begun = time.monotonic()
    return lambda played_s: time.sleep(max(0.0, begun + played_s - time.monotonic()))


@contextmanager
def _wishes() -> Iterator[Callable[[], Wish]]:
    """Yield a function that tells what the person at the keyboard wishes; Ctrl-C and SIGTERM are a wish to stop."""
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
    """Let keys come without Enter, where there is a terminal."""
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


def _shown(played: Played, reference: Path) -> Table:
    table = Table("what", "time (s)", title=str(reference))
    for words, seconds in (
        ("length", played.duration_s),
        ("played", played.played_s),
        ("paused", played.paused_s),
        ("at a limit of a converter", played.saturated_s),
    ):
        table.add_row(words, f"{seconds:.2f}")
    return table
