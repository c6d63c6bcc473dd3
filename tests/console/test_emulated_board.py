"""A study at a console that holds an emulated board: the board plays the trials, at its own time."""

import sqlite3

import pytest

from tests.console.pages import dropped
from tests.console.rig_page import Studies, answered, at_subject, loaded
from tests.experiment.session.apparatuses import PROTOCOL

RIG = "emulated:mps2-an386"
INTERVALS = """SELECT interval.onset_s, interval.duration_s, trial.presentations, trial.rig_tick, run.rig_simulated
FROM interval JOIN trial ON trial.id = interval.trial_id JOIN run ON run.id = trial.run_id ORDER BY interval.id"""


@pytest.mark.slow
def test_study__at_an_emulated_board__is_played_by_it_with_the_onsets_of_the_protocol(console, tmp_path):
    (tmp_path / "short.toml").write_text(PROTOCOL)
    protocol = dropped(console.state, tmp_path / "short.toml")
    with loaded(console), console.websocket_connect("/ws/study") as socket:
        studies = Studies(socket)
        assert "error" not in studies.ask("begin", protocol=protocol, store="board.db", auto_start=True)
        with at_subject(console) as subject:
            answered(subject, 3)
        studies.ask("end")
    connection = sqlite3.connect(console.folder / "board.db")
    found = connection.execute(INTERVALS).fetchall()
    connection.close()
    assert len(found) == 9
    tick = 1.0 / console.host.display.rate_hz
    onsets = [0.01 + position * (found[0][1] + 0.01) for position in range(3)] * 3
    assert [one[0] for one in found] == pytest.approx(onsets, abs=tick)
    assert [one[1] for one in found] == pytest.approx([2 / 30] * 9, abs=tick)  # whole periods of 30 Hz, at least 50 ms
    assert {one[2] for one in found} == {1}
    assert [one[3] for one in found] == sorted(one[3] for one in found)  # the board's own ticks
    assert {one[4] for one in found} == {1}  # nobody can feel an emulated display
