"""The state: what is designed and checked there is what `design` and `check` give, to the last printed digit."""

import json
import pickle

import pytest

from tactuator.cli.main import main
from tactuator.console.loop_chart import channel_figures, settled_figures
from tactuator.console.loop_shape import LoopShape
from tactuator.console.state import FILE, ConsoleState
from tactuator.errors import BadInput
from tactuator.io.controller import controller_text, read_controller
from tactuator.report.tables import design_rows, finding_row
from tactuator.synthesis.verdict import whole_verdict
from tests.console.pages import ONE


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    """A display of one channel, its controller by the command line, and the console's state with its own design."""
    folder = tmp_path_factory.mktemp("console")
    path = folder / "display.toml"
    path.write_text(ONE)
    assert main(["design", str(path), "--out", str(folder / "controller.json"), "--json"]) == 0
    state = ConsoleState(path)
    return folder / "controller.json", state, state.designed(FILE, "index")


def test_design__saved_and_shown__is_the_file_of_design_with_the_figures_that_design_and_check_print(designed):
    path, state, shape = designed
    assert controller_text(state.controller(FILE, {"index": shape})) == path.read_text()
    controller = read_controller(path)
    figures = channel_figures(state.plants(FILE, "index"), state.channel_of(FILE, "index", shape))
    assert figures["design"] == [list(row) for row in design_rows(controller.channels)]
    objectives = whole_verdict(controller).objectives
    rows = [[*finding_row(one), one.remark] for objective in objectives for one in objective.worst()]
    assert figures["verdict"]["rows"] == rows


def test_figures__of_a_shape_through_an_address_or_in_another_process__are_the_same(designed):
    _, state, shape = designed
    plants, channel = state.plants(FILE, "index"), state.channel_of(FILE, "index", shape)
    figures = channel_figures(plants, channel)
    gone = LoopShape(shape.gain_db + 1e-13, shape.factors)  # not the one that is remembered
    assert channel_figures(plants, state.channel_of(FILE, "index", gone)) == figures
    given = plants, state.system(FILE, "index", shape), state.known(FILE, "index", shape)
    there, computed = pickle.loads(pickle.dumps(settled_figures(*pickle.loads(pickle.dumps(given)))))
    assert (computed, there.document()) == (figures, channel.document())


def test_saved__after_a_drag__is_judged_by_check_as_on_the_page(designed, tmp_path, capsys):
    _, state, shape = designed
    moved = LoopShape(shape.gain_db - 1.5, shape.factors)
    saved = tmp_path / "controller.json"
    saved.write_text(controller_text(state.controller(FILE, {"index": moved})))
    capsys.readouterr()
    assert main(["check", str(saved), "--json"]) in (0, 1)
    printed = json.loads(capsys.readouterr().out)
    shown = channel_figures(state.plants(FILE, "index"), state.channel_of(FILE, "index", moved))
    outcomes = {row[0]: row[2] for row in shown["verdict"]["rows"]}
    assert printed["objectives"]["iv"]["outcome"] == outcomes["iv"]
    assert printed["outcome"] in shown["verdict"]["sentence"]


def test_start__has_every_example_and_a_stable_loop_for_each():
    state = ConsoleState()
    assert state.named is None
    keys = [one["key"] for one in state.examples()]
    assert "example:display.toml" in keys
    for key in keys:
        for channel in state.display(key).channels:
            if channel.feedback.structure != "none":
                state.first_shape(key, channel.name).system(state.display(key).rate_hz)


def test_display__by_a_key_that_is_none__is_refused(designed):
    for key in ("file", "example:../../secret.toml", "example:README.md", "/etc/passwd", ""):
        with pytest.raises(BadInput, match="allowed"):
            ConsoleState().display(key)
    with pytest.raises(BadInput, match="not on the server any more"):
        ConsoleState().display("text:0123")
    with pytest.raises(BadInput, match="'index' has no loop yet"):
        designed[1].controller(FILE, {})
