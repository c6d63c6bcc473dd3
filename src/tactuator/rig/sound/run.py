"""One run on a sound card: fed ahead, read as it comes, and broken off where it has a gap or the card falls silent."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from tactuator.errors import DeviceFault
from tactuator.rig.sound.rows import CardRows, Rows

POLL_S = 0.01
"""Pause between two looks at the rings."""
SILENT_S = 1.0
"""A card that does not call back for so long is gone."""
STARTING_S, STEADY = 5.0, 5
"""Until it has called back so often it has longer: PulseAudio calls once, and then not for 1.7 s."""


class CardGone(DeviceFault):
    """The card does not call back any more: unplugged, or its server has ended."""


class CardRun:
    """Runs on `rows`, one at a time. lead: rows by which one is fed ahead."""

    def __init__(self, rows: CardRows, lead: int, sleep: Callable[[float], None]) -> None:
        self._rows, self.lead, self._sleep = rows, lead, sleep
        self._seen, self._silent_s, self._steps = -1, 0.0, 0
        self.alive = True

    def play(self, blocks: Iterable[Rows], beyond: int, allow_gaps: bool) -> Iterator[Rows]:
        """Put out blocks (n, outputs) one after another and yield what is taken in, (n, inputs), from the first row put
        out until `beyond` rows after the last.

        Raises SoundGap and CardGone; however it ends, what is put out dies away.
        """
        self.settle()
        source = iter(blocks)
        fed = got = 0
        more, begun = True, False
        waiting: Rows | None = None
        try:
            while more or got < fed + beyond:
                while more and fed - self._rows.played < self.lead:
                    if waiting is None or not len(waiting):
                        waiting = next(source, None)
                    if waiting is None:
                        more = False
                        self._rows.end()
                        break
                    taken = self._rows.feed(waiting)
                    fed, waiting = fed + taken, waiting[taken:]
                    if not taken and len(waiting):
                        break
                if not fed:
                    return
                if not begun:
                    self._rows.begin()
                    begun = True
                part = self._rows.read(self.lead)
                self._rows.check(allow_gaps)
                got += len(part)
                if len(part):
                    yield part
                if len(part) < self.lead // 2:
                    self._wait()
        finally:
            self._rows.stop()

    def settle(self) -> None:
        """Wait until the run before has died away. Raises CardGone."""
        while not self._rows.forget():
            self._wait()

    def _wait(self) -> None:
        """Wait a little. Raises CardGone where the card's clock stands still."""
        self._sleep(POLL_S)
        frames = self._rows.frames
        if frames != self._seen:
            self._seen, self._silent_s, self._steps = frames, 0.0, self._steps + 1
            return
        self._silent_s += POLL_S
        patience_s = SILENT_S if self._steps > STEADY else STARTING_S
        if self._silent_s > patience_s:
            self.alive = False
            raise CardGone(
                f"the sound card has stopped: not a sample for {patience_s:g} s", "a card that stays connected"
            )
