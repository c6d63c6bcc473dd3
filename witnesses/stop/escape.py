"""Escape in each state of a subject's page: how long after the key anything is felt.

`python -m witnesses.stop.escape --times 10` serves a study on the simulated display in real time, opens the subject's
page in Chromium, brings it to a state, and presses Escape. A feeler at the finger port keeps every displacement with
the wall clock's time at which it is felt; the key's time is that of its event in the browser. Felt is the amplitude of
the tone in one of its periods, a drift aside. Every interval has a tone of 30 dB SL. Between intervals the display's
own noise reaches 3 dB SL in a period, so that silence is 6 dB SL or less. The claim: silence within 20 ms of the key,
and from then on, in every state; nothing is played before the subject goes on.

The last state is the console's, with live sound (a tone of 30 dB SL from a file at its own pace) on the rig in its
separate process, which keeps what is felt there.

The time is that of page, browser, connection, server and display together, on a machine that does nothing else: what
waits for a processor waits longer. Seen to fail: `--pieces 0.02` (seconds that are computed at a time).
"""

from __future__ import annotations

import argparse
import pickle
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
from numpy.typing import NDArray
from playwright.sync_api import sync_playwright
from rich.console import Console
from rich.table import Table

from tactuator.api.parameters import paper_controller, paper_display
from tactuator.console import rig_process, rig_worker
from tactuator.console.page_server import build_console
from tactuator.console.rig_worker import hold_rig
from tactuator.console.state import ConsoleState
from tactuator.experiment.protocol.detection import Protocol
from tactuator.experiment.protocol.file import parse_protocol
from tactuator.experiment.session.studies import open_study
from tactuator.experiment.session.task import Apparatus, SystemClock
from tactuator.experiment.session.tone_task import DetectionTask
from tactuator.experiment.store.store import Store
from tactuator.io.shipped import EXAMPLES
from tactuator.model.description import Display
from tactuator.rig import simulated as paced
from tactuator.rig.simulated import SimulatedRig
from tactuator.web.lab import Lab
from tactuator.web.study_pages import build_app
from tests.browser import ARGUMENTS, chromium
from tests.web.server import served

FREQUENCY_HZ, SILENT_DB_SL, SILENT_MS = 100.0, 6.0, 20.0
WATCHED_MS = 1500.0
PROTOCOL = """
[study]
name = "stopped"
seed = 7
consent = "You may stop at any time."
[procedure]
kind = "up-down"
start_db_sl = 30
[conditions]
fingers = ["index"]
frequencies_hz = [100]
[timing]
stimulus_s = 0.5
ramp_s = 0.02
gap_s = 0.4
lead_s = 0.4
feedback_s = 0.6
[masker]
kind = "tone"
frequency_hz = 100
level_db_sl = 30
[circumstances]
masking_sound = "pink"
[session]
practice_trials = 2
practice_correct = 1
break_after_trials = 1
[[subject]]
code = "S1"
"""
_KEY_TIMES = """addEventListener("keydown", (event) => {
  if (event.key === "Escape") window.escaped = performance.timeOrigin + event.timeStamp;
}, true)"""


class Felt:
    """Every stretch of displacement of a finger, with the wall clock's time of its first sample.

    runs: while it is cleared, the rig's time stands still.
    """

    def __init__(self, rate_hz: float, silent_mm: float) -> None:
        self.rate_hz, self.silent_mm = rate_hz, silent_mm
        self.stretches: list[tuple[float, NDArray[np.float64]]] = []
        self.runs = threading.Event()
        self.runs.set()

    def __call__(self, displacement_mm: NDArray[np.float64]) -> None:
        """Keep a stretch."""
        self.stretches.append((time.time(), displacement_mm))
        self.runs.wait()

    def _amplitude_mm(self, displacement_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the tone's amplitude in the period that begins at each sample, (n - period + 1,)."""
        period = round(self.rate_hz / FREQUENCY_HZ)
        at_s = np.arange(period) / self.rate_hz
        turns = 2.0 * np.pi * FREQUENCY_HZ * at_s
        fit = np.linalg.pinv(np.column_stack([np.cos(turns), np.sin(turns), np.ones(period), at_s]))[:2]
        return np.asarray(np.hypot(*(fit @ np.lib.stride_tricks.sliding_window_view(displacement_mm, period).T)))

    def tone_ms(self, first: int) -> float:
        """Return how long the tone is felt from that stretch on, by the rig's own time."""
        later = np.concatenate([np.zeros(round(self.rate_hz)), *(mm for _, mm in self.stretches[first:])])
        return 1e3 * float(np.sum(self._amplitude_mm(later) > self.silent_mm)) / self.rate_hz

    def lasts_ms(self, key_ms: float) -> float:
        """Return how long after the key the tone is felt, ms; 0 where it is not.

        A stretch lasts until the next one begins: the second of rest that a computed display is given at a stop is
        computed at once.
        """
        period, last = round(self.rate_hz / FREQUENCY_HZ), 0.0
        stretches = list(self.stretches)  # the rig may go on
        ends_s = [began_s for began_s, _ in stretches[1:]] + [np.inf]
        before = np.zeros(0)
        for (began_s, mm), end_s in zip(stretches, ends_s, strict=False):
            joined = np.concatenate([before, mm])
            after_ms = 1e3 * (began_s + (np.arange(joined.size) - before.size) / self.rate_hz) - key_ms
            if joined.size >= period:
                amplitude_mm = self._amplitude_mm(joined)
                at_ms = after_ms[: amplitude_mm.size]
                felt = (amplitude_mm > self.silent_mm) & (at_ms > 0.0) & (at_ms < 1e3 * end_s - key_ms)
                last = max(last, float(at_ms[felt].max(initial=0.0)))
            cut_short = end_s - began_s < 0.9 * mm.size / self.rate_hz and mm.size > 10 * period
            before = np.zeros(0) if cut_short else joined[-(period - 1) :]
        return last


def felt_on(display: Display) -> Felt:
    level_db = float(display.channels[0].threshold.curve.level_db_re_1um_at(FREQUENCY_HZ)) + SILENT_DB_SL
    return Felt(display.rate_hz, 1e-3 * 10.0 ** (level_db / 20.0))


def _until(page: Any, condition: str) -> None:
    page.wait_for_function(condition)


def _introduced(page: Any) -> None:
    page.keyboard.press("Enter")
    _until(page, "page.stage === 'introduction'")


def _asked(page: Any) -> None:
    _introduced(page)
    page.evaluate("go()")


def _lead(page: Any) -> None:
    _introduced(page)
    page.keyboard.press("Enter")
    _until(page, "!el('choices').hidden")


def _interval(number: int) -> Callable[[Any], None]:
    def go_there(page: Any) -> None:
        _lead(page)
        lit = f"document.querySelectorAll('.choice')[{number}]?.classList.contains('lit')"
        _until(page, f"{lit} || page.pending !== null")
        while not page.evaluate(lit):  # over before a busy browser could say so: the trial is played again
            page.reload()
            page.locator("#go").wait_for()
            page.keyboard.press("Enter")
            _until(page, f"{lit} || page.pending !== null")
        page.wait_for_timeout(100)

    return go_there


def _gap(page: Any) -> None:
    _interval(0)(page)
    _until(page, "document.querySelector('.choice.lit') === null")


def _answer(page: Any) -> None:
    _lead(page)
    _until(page, "page.pending !== null")


def _feedback(page: Any) -> None:
    _answer(page)
    page.keyboard.press("1")
    _until(page, "page.pending === null && page.unsaved === null")


def _break(page: Any) -> None:
    _answer(page)
    page.keyboard.press("1")
    _until(page, "page.stage === 'break'")


def _paused(page: Any) -> None:
    _interval(0)(page)
    page.keyboard.press("Escape")
    _until(page, "page.stage === 'paused'")


def _resumed(page: Any) -> None:
    _paused(page)
    page.keyboard.press("Enter")


def _stopped(page: Any) -> None:
    _paused(page)
    page.locator("#others button").first.click()
    _until(page, "page.stage === 'stopped'")


def _leaving(page: Any) -> None:
    _interval(0)(page)
    page.locator("#others button").last.click()


def _asked_to_leave(page: Any) -> None:
    _paused(page)
    page.locator("#others button").last.click()


STATES: dict[str, Callable[[Any], None]] = {
    "consent": lambda page: None,
    "introduction": _introduced,
    "going on": _asked,
    "lead": _lead,
    "interval 1": _interval(0),
    "gap": _gap,
    "interval 2": _interval(1),
    "interval 3": _interval(2),
    "answer": _answer,
    "feedback": _feedback,
    "break": _break,
    "pause": _paused,
    "after a pause": _resumed,
    "stopped for today": _stopped,
    "leaving": _leaving,
    "leaving, asked how": _asked_to_leave,
}


@contextmanager
def subject_page(browser: Any, folder: Path) -> Iterator[tuple[Any, Felt, Lab]]:
    """Yield the page of a subject whose study has just been opened, what the finger feels, and the lab."""
    controller = paper_controller(paper_display())
    rig = SimulatedRig(controller.display, 1)
    rig.load(controller)
    felt = felt_on(rig.display)
    rig.finger("index").attach(felt)
    task = DetectionTask(parse_protocol(PROTOCOL, Protocol), Apparatus(paced.PacedRig(rig), controller, "simulated"))
    store = Store(folder / "lab.db")
    lab = Lab(open_study(store, task, PROTOCOL, SystemClock(), lambda code, visit: f"token-{code}"), auto_start=True)
    try:
        with served(build_app(lab, "the operator's own")) as client:
            page = browser.new_page(bypass_csp=True)
            page.add_init_script(_KEY_TIMES)
            page.goto(f"http://127.0.0.1:{client.port}/s/token-S1")
            page.locator("#go").wait_for()
            yield page, felt, lab
            page.close()
    finally:
        felt.runs.set()
        lab.close()
        store.close()


def escaped(page: Any, felt: Felt, state: str) -> tuple[float, str, bool]:
    """Press Escape in that state: return how long the tone is felt after it, ms, the page's stage WATCHED_MS later, and
    whether the masking sound is on then.
    """
    STATES[state](page)
    page.keyboard.press("Escape")
    page.wait_for_timeout(WATCHED_MS)
    return (
        felt.lasts_ms(page.evaluate("window.escaped")),
        page.evaluate("page.stage"),
        page.evaluate("page.noise.context !== null"),
    )


LIVE = "console, live"


def hold_felt_rig(kept: Path, pieces_s: float, pipe: Any, spec: str, display: Display, seed: int) -> None:
    """Hold the rig in the console's process of it, and leave in a file what was felt at its finger port."""
    rig, felt = SimulatedRig(display, seed), felt_on(display)
    rig.finger("index").attach(felt)
    paced._PIECE_S = pieces_s
    vars(rig_worker)["open_rig"] = lambda spec, display, seed: rig
    hold_rig(pipe, spec, display, seed)
    kept.write_bytes(pickle.dumps(felt.stretches))


def live_escaped(browser: Any, folder: Path, wait_ms: float) -> tuple[float, str]:
    """Press Escape while live sound is felt: return how long the tone is felt after it, ms, and the rig's mode then."""
    controller, sound = paper_controller(paper_display()), folder / "tone.wav"
    time_s = np.arange(16000 * 60) / 16000
    tone = 0.1 * np.sin(2.0 * np.pi * FREQUENCY_HZ * time_s) * (time_s % 3.0 < 2.8)  # what never pauses is noise
    soundfile.write(sound, tone, 16000)
    state = ConsoleState(EXAMPLES / "display.toml", folder)
    state.uploads.path = lambda key: sound  # type: ignore[method-assign]
    vars(rig_process)["hold_rig"] = partial(hold_felt_rig, folder / "felt", paced._PIECE_S)
    with (
        closing(rig_process.RigProcess("simulated", controller.display, 1)) as host,
        served(build_console(state, "token", rig=host)) as client,
    ):
        host.call("load", controller)
        page = browser.new_page(bypass_csp=True)
        page.add_init_script(_KEY_TIMES)
        page.goto(f"http://127.0.0.1:{client.port}/#token=token&view=speech&display=file")
        page.locator("#live-level").fill("30")
        page.locator("#live-start:not([disabled])").click()
        _until(page, "Number(document.querySelector('[role=meter]')?.getAttribute('aria-valuenow')) > 20")
        page.wait_for_timeout(500.0 + wait_ms)
        page.keyboard.press("Escape")
        page.wait_for_timeout(WATCHED_MS)
        key_ms, mode = page.evaluate("window.escaped"), str(host.status.mode)
        page.close()
    felt, before = felt_on(controller.display), felt_on(controller.display)
    felt.stretches = pickle.loads((folder / "felt").read_bytes())
    before.stretches = [stretch for stretch in felt.stretches if 0.0 < key_ms - 1e3 * stretch[0] < 200.0]
    if not before.tone_ms(0) > 20.0:
        raise AssertionError(
            f"before the key the tone was felt for {before.tone_ms(0):.0f} ms of {len(before.stretches)} pieces"
        )
    return felt.lasts_ms(key_ms), mode


def main() -> int:
    """Print the longest and the median time of each state."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--state", action="append", choices=(*STATES, LIVE))
    parser.add_argument("--pieces", type=float, default=None)
    chosen = parser.parse_args()
    if chosen.pieces is not None:
        paced._PIECE_S = chosen.pieces
    table = Table("state", "median ms", "longest ms", "then")
    longest = 0.0
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        for state in chosen.state or (*STATES, LIVE):
            lasts, stage = [], ""
            for number in range(chosen.times):
                if state == LIVE:
                    with tempfile.TemporaryDirectory() as folder:
                        lasts_ms, stage = live_escaped(browser, Path(folder), 7.0 * number)
                    lasts.append(lasts_ms)
                    continue
                with tempfile.TemporaryDirectory() as folder, subject_page(browser, Path(folder)) as (page, felt, _):
                    lasts_ms, stage, _ = escaped(page, felt, state)
                    lasts.append(lasts_ms)
            longest = max(longest, *lasts)
            table.add_row(state, f"{np.median(lasts):.1f}", f"{max(lasts):.1f}", stage)
        browser.close()
    Console().print(table)
    return 0 if longest <= SILENT_MS else 1


if __name__ == "__main__":
    sys.exit(main())
