"""Clicks from the source to the finger port, by `listen` as anyone calls it: the delay of what is felt.

What is felt is the displacement at the finger port, weighted here by the inverse of the threshold curve's file (read
here), with zero phase; the delay ends at its greatest magnitude within 100 ms. On a board's stream: the core's board in
this process, which runs half a millisecond with each request of its link and while its host sleeps, and is never waited
for. Run: python -m witnesses.live.delay CONTROLLER [CLICKS [CODING ...]] [--board].
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

import tactuator as tt
from tactuator.rig.board.link import LinkClient
from tactuator.rig.board.rig import BoardRig
from tactuator.rig.transport import InProcess
from tactuator.speech.coding import coding_of
from tactuator.speech.live.level import LevelSettings
from tactuator.speech.live.run import fed_shortly, run_live
from tactuator.speech.live.source import FileSource
from tactuator.speech.live.stream import LiveStream
from witnesses.live.limits import FloatArray, felt_of

RATE_IN, EVERY_S = 48000, 0.2
GAIN_DB, CODINGS = 85.0, ("direct", "bands", "envelope")


class Link(InProcess):
    """A board that runs half a millisecond with each request, once its display has its controller."""

    alone = False

    def _let_run(self) -> None:
        self.run(2) if self.alone else super()._let_run()

    def sleep(self, ticks: float) -> None:
        self.run(round(ticks))


class FromTick(FileSource):
    """A file that knows the tick of the board at which it was begun."""

    begun_s: float | None = None

    def read(self, now_s: float) -> FloatArray:
        self.begun_s = now_s if self.begun_s is None else self.begun_s
        return super().read(now_s)


def on_board(controller: Any, coding: str, sound: Path) -> tuple[dict[str, FloatArray], float]:
    """Displacement by finger, and the time of the sound's first sample in it."""
    link = Link()
    rig = BoardRig(LinkClient(link), controller.display, lambda seconds: link.sleep(seconds * rig.rate_hz), waits=False)
    rig.simulate(1)
    rig.load(controller)
    moved = felt_at(rig)
    link.alone, source = True, FromTick(sound)
    level = LevelSettings(gain_db=GAIN_DB, gate_db=0.0)
    stream = LiveStream(source, controller, coding_of(coding), level, lambda: float(link.board.tick / rig.rate_hz))
    with fed_shortly(rig):
        run_live(stream, rig, source, lambda trace: None)
    print(f"missed {stream.state.missed}, drop-outs {stream.state.dropouts}")
    assert source.begun_s is not None
    assert rig.began_at is not None
    return joined(moved), source.begun_s - rig.began_at / rig.rate_hz


def in_this_process(controller: Any, coding: str, sound: Path) -> tuple[dict[str, FloatArray], float]:
    rig = tt.SimulatedRig(controller.display, seed=1)
    moved = felt_at(rig)
    tt.listen(rig, controller, sound, coding=coding, gain_db=GAIN_DB, gate_db=0.0, fast=True).run()
    return joined(moved), 0.0


def felt_at(rig: Any) -> dict[str, list[FloatArray]]:
    moved: dict[str, list[FloatArray]] = {name: [] for name in rig.channels}
    for name, pieces in moved.items():
        rig.finger(name).attach(pieces.append)
    return moved


def joined(moved: dict[str, list[FloatArray]]) -> dict[str, FloatArray]:
    return {name: np.concatenate(pieces) for name, pieces in moved.items()}


def delays_ms(controller: Any, coding: str, clicks: int, folder: Path, board: bool) -> dict[str, FloatArray]:
    rng = np.random.default_rng(0)
    begin = (RATE_IN * (0.2 + EVERY_S * np.arange(clicks)) + rng.integers(0, 4000, clicks)).astype(int)
    sound = np.zeros(round(RATE_IN * EVERY_S * (clicks + 3)))
    sound[begin] = 0.9
    soundfile.write(folder / "clicks.wav", sound, RATE_IN)
    moved, begun_s = (on_board if board else in_this_process)(controller, coding, folder / "clicks.wav")
    found, rate_hz = {}, controller.rate_hz
    for name, displacement in moved.items():
        felt, late = np.abs(felt_of(displacement, rate_hz)), []
        for at in (begun_s + begin / RATE_IN) * rate_hz:
            first = int(np.ceil(at))
            late.append((first + np.argmax(felt[first : first + round(0.1 * rate_hz)]) - at) / rate_hz * 1e3)
        found[name] = np.array(late)
    return found


def main() -> None:
    asked = [each for each in sys.argv[1:] if each != "--board"]
    controller, clicks = tt.read_controller(asked[0]), int(asked[1]) if len(asked) > 1 else 1000
    with tempfile.TemporaryDirectory() as folder:
        for coding in asked[2:] or CODINGS:
            for name, late in delays_ms(controller, coding, clicks, Path(folder), "--board" in sys.argv).items():
                figures = f"median {np.median(late):.1f} ms, worst {late.max():.1f} ms, least {late.min():.1f} ms"
                print(f"{coding} {name}: {clicks} clicks, {figures}", flush=True)


if __name__ == "__main__":
    main()
