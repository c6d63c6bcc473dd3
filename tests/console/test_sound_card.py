"""A whole experiment in the console's page on a simulated sound card: in Chromium, by keyboard, in real time.

The subject is a script that detects by Weibull's function of the displacement that the card's own port tells.
"""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactuator.console.app import build_console
from tactuator.console.rig_process import RigProcess
from tactuator.console.state import ConsoleState
from tactuator.io.controller import write_controller
from tests.console.pages import TOKEN, address_of, opened_page, pressed
from tests.rig.sound.from_start_to_end import EXCITER, PROTOCOL, RATE_HZ, TRUE_DB_SL, controller
from tests.rig.sound.simulated_card import PERIOD, simulated_card
from tests.web.server import served
from tests.web.study import Subject

LEAD_S, STIMULUS_S, GAP_S, TONE_HZ = 0.3, 0.3, 0.1, 140.0
RUNS = """SELECT run.state, trial.rig_tick, interval.commanded_db_sl, interval.measured_db_sl
FROM run JOIN trial ON trial.run_id = run.id JOIN interval ON interval.trial_id = trial.id
JOIN response ON response.trial_id = trial.id ORDER BY interval.id"""


class Felt:
    def __init__(self, host: RigProcess, threshold_mm: float) -> None:
        self.threshold_mm, self.traces = threshold_mm, []
        told = host.presented

        def heard(piece):
            if piece is not None and piece.trace is not None:
                if self.over:
                    self.traces.clear()
                self.over = False
                self.traces.append(piece.trace.position_v[:, 0])
            elif piece is not None and piece.over:
                self.over = True
            told(piece)

        self.over = True
        host.presented = heard

    def levels_db_sl(self) -> np.ndarray:
        moved = np.concatenate(self.traces)
        found = []
        for k in range(3):
            at = LEAD_S + k * (STIMULUS_S + GAP_S) + 0.1
            rows = np.arange(round(at * RATE_HZ), round((at + 0.1) * RATE_HZ))
            tone = 2.0 * np.mean(moved[rows] * np.exp(-2j * np.pi * TONE_HZ * rows / RATE_HZ))
            found.append(20.0 * np.log10(max(abs(tone), 1e-9) / self.threshold_mm))
        return np.array(found)


def person_of(felt: Felt, levels: list[np.ndarray]) -> Callable[[int, int], str]:
    rng = np.random.default_rng(5)

    def key(run: int, number: int) -> str:
        found = felt.levels_db_sl()
        levels.append(found)
        loudest = int(np.argmax(found))
        above = 10.0 ** ((found[loudest] - TRUE_DB_SL) / 20.0)
        detects = rng.random() < 1.0 - np.exp(-np.log(3.2) * above**2.5)
        return str(loudest + 1 if detects else rng.integers(1, 4))

    return key


def begin(page: Any, folder: Path) -> None:
    page.set_input_files("#controller-file", folder / "controller.json")
    page.wait_for_selector("#loaded:not(:has-text('none'))")
    page.set_input_files("#protocol-file", folder / "card.toml")
    page.wait_for_selector("#about-protocol:has-text('“card”')")
    pressed(page, "#begin", "#study:has-text('card')")


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("jackd") is None, reason="no jackd here: python3 tools/install.py slow")
def test_experiment__in_the_page_on_a_sound_card__from_start_to_end(browser, tmp_path):
    made = controller(PERIOD)  # what is put out comes back a period later
    threshold_mm = float(made.display.channels[0].threshold.curve.displacement_mm(np.array([TONE_HZ]))[0])
    (tmp_path / "card.toml").write_text(PROTOCOL)
    write_controller(tmp_path / "controller.json", made)
    levels: list[np.ndarray] = []
    with (
        simulated_card([EXCITER, None]) as card,
        closing(RigProcess(f"sound:{card.device}", made.display)) as host,
        served(build_console(ConsoleState(folder=tmp_path), TOKEN, rig=host)) as client,
        opened_page(browser, f"{address_of(client)}&view=experiment", "experiment") as page,
    ):
        begin(page, tmp_path)
        felt = Felt(host, threshold_mm)
        pressed(page, "[data-start='S1']", "#state:has-text('running')")
        own = browser.new_page()
        own.goto(f"http://127.0.0.1:{client.port}{page.locator('#sessions a').first.get_attribute('href')}")
        subject = Subject(own, tmp_path / "card.toml", person_of(felt, levels))
        while subject.act():
            pass
        own.close()
        page.wait_for_selector("#state:has-text('nobody')")
        pressed(page, "#end-study", "#begin:not([disabled])")
    (store,) = tmp_path.glob("*.db")
    with closing(sqlite3.connect(store)) as connection:
        rows = connection.execute(RUNS).fetchall()
    assert len(rows) // 3 == len(subject.acknowledged) == len(levels) > 20
    assert {row[0] for row in rows} == {"done"}
    assert np.all(np.diff([row[1] for row in rows[::3]]) > 0)
    # what the card's own port says, and what the program stored, of the interval that held the tone
    asked = np.array([row[2] for row in rows if row[2] is not None])
    stored = np.array([row[3] for row in rows if row[2] is not None])
    loud = asked > 6.0
    assert np.max(np.abs(np.max(levels, axis=1) - asked)[loud]) < 0.1
    assert np.max(np.abs(stored - asked)[loud]) < 0.1
