"""The workshop: what is designed and checked there is what `design` and `check` give, to the last printed digit."""

import json
import pickle

import pytest

from tactuator.cli.main import main
from tactuator.console.figures import channel_figures, settled_figures
from tactuator.console.shaping.factors import LoopShape
from tactuator.console.workshop import FILE, Workshop
from tactuator.errors import BadInput
from tactuator.io.controller import controller_text, read_controller
from tactuator.io.shipped import EXAMPLES
from tactuator.report.tables import design_rows, finding_row
from tactuator.synthesis.verdict import whole_verdict

ONE = (EXAMPLES / "display.toml").read_text("utf-8").partition('[[channel]]\nname = "thumb"')[0]


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    """A display of one channel, its controller by the command line, and the console's workshop with its own design."""
    folder = tmp_path_factory.mktemp("console")
    path = folder / "display.toml"
    path.write_text(ONE)
    assert main(["design", str(path), "--out", str(folder / "controller.json"), "--json"]) == 0
    workshop = Workshop(path)
    return folder / "controller.json", workshop, workshop.designed(FILE, "index")


def test_saved__as_it_was_designed__is_the_file_of_design(designed):
    path, workshop, shape = designed
    assert controller_text(workshop.controller(FILE, {"index": shape})) == path.read_text()


def test_figures__of_a_design__are_those_that_design_and_check_print(designed):
    path, workshop, shape = designed
    controller = read_controller(path)
    found = channel_figures(workshop.bench(FILE, "index"), workshop.made(FILE, "index", shape))
    assert found["design"] == [list(row) for row in design_rows(controller.channels)]
    objectives = whole_verdict(controller).objectives
    rows = [[*finding_row(one), one.remark] for objective in objectives for one in objective.worst()]
    assert found["verdict"]["rows"] == rows


def test_figures__of_a_shape_that_came_through_an_address__print_the_same(designed):
    _, workshop, shape = designed
    gone = LoopShape(shape.gain_db + 1e-13, shape.factors)  # not the one that is remembered
    own = workshop.made(FILE, "index", gone)
    found = channel_figures(workshop.bench(FILE, "index"), own)
    assert found == channel_figures(workshop.bench(FILE, "index"), workshop.made(FILE, "index", shape))


def test_figures__computed_in_another_process__are_the_same(designed):
    _, workshop, shape = designed
    given = workshop.bench(FILE, "index"), workshop.system(FILE, "index", shape), workshop.known(FILE, "index", shape)
    own, found = pickle.loads(pickle.dumps(settled_figures(*pickle.loads(pickle.dumps(given)))))
    assert found == channel_figures(given[0], workshop.made(FILE, "index", shape))
    assert own.document() == workshop.made(FILE, "index", shape).document()


def test_saved__after_a_drag__is_judged_by_check_as_on_the_page(designed, tmp_path, capsys):
    _, workshop, shape = designed
    moved = LoopShape(shape.gain_db - 1.5, shape.factors)
    saved = tmp_path / "controller.json"
    saved.write_text(controller_text(workshop.controller(FILE, {"index": moved})))
    capsys.readouterr()
    assert main(["check", str(saved), "--json"]) in (0, 1)
    printed = json.loads(capsys.readouterr().out)
    shown = channel_figures(workshop.bench(FILE, "index"), workshop.made(FILE, "index", moved))
    outcomes = {row[0]: row[2] for row in shown["verdict"]["rows"]}
    assert printed["objectives"]["iv"]["outcome"] == outcomes["iv"]
    assert printed["outcome"] in shown["verdict"]["sentence"]


def test_start__has_every_example_and_a_stable_loop_for_each():
    workshop = Workshop()
    assert workshop.named is None
    keys = [one["key"] for one in workshop.examples()]
    assert "example:display.toml" in keys
    for key in keys:
        for channel in workshop.display(key).channels:
            if channel.feedback.structure != "none":
                workshop.begun(key, channel.name).system(workshop.display(key).rate_hz)


@pytest.mark.parametrize("key", ["file", "example:../../secret.toml", "example:README.md", "/etc/passwd", ""])
def test_display__by_a_key_that_is_none__is_refused(key):
    with pytest.raises(BadInput, match="allowed"):
        Workshop().display(key)


def test_controller__with_a_channel_missing__names_it(designed):
    _, workshop, _ = designed
    with pytest.raises(BadInput, match="'index' has no loop yet"):
        workshop.controller(FILE, {})
