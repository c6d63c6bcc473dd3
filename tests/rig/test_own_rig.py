"""Rigs of other packages: the page's example is short, is found by its name, and what fails ends a verb as ours do."""

import re

import pytest

from tactuator.api.parameters import paper_display
from tactuator.cli.main import main
from tactuator.errors import BadInput
from tactuator.io.controller import write_controller
from tactuator.rig.open import RIGS, open_rig
from tests.rig.guard.guarded import designed
from tests.rig.own_rig import example, installed_example

DISPLAY = paper_display()


def test_example__of_the_page__has_at_most_60_lines() -> None:
    assert len(example()[0].splitlines()) <= 60


def test_open_rig__example_installed__is_found_by_its_name() -> None:
    with installed_example() as name:
        assert type(open_rig(name, DISPLAY)).__name__ == "ComputedRig"
        with pytest.raises(BadInput, match=f"board, in-process, {name}, simulated, sound"):
            open_rig("toaster", DISPLAY)


FAILS = """
from tactuator.errors import BadInput, DeviceFault
from tactuator.rig.simulated import SimulatedRig

class Broken(SimulatedRig):
    def play(self, reference):
        raise DeviceFault("the amplifier is hot")

def opened(rest, display, seed):
    if rest == "nothing":
        return 3
    if rest != "hot":
        raise BadInput(f"amplifier {rest!r}", "hot")
    return Broken(display, seed)
"""


@pytest.mark.parametrize(
    ("rig", "status", "words"),
    [
        ("own:hot", 3, "the amplifier is hot"),
        ("own:cold", 2, "amplifier 'cold'; expected hot"),
        ("own:nothing", 2, "rig 'own:nothing' is a int; expected what has all that tactuator.rig.rig.Rig asks for"),
    ],
)
def test_measure__own_rig_that_fails__one_line_and_the_status(rig, status, words, install, tmp_path, capsys) -> None:
    install(RIGS, "own", FAILS, "opened")
    path = tmp_path / "controller.json"
    write_controller(path, designed())
    assert (
        main(["measure", "response", "--controller", str(path), "--rig", rig, "--out", str(tmp_path / "out.h5")])
        == status
    )
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.strip()]
    assert re.search(re.escape(words), line)
    assert not (tmp_path / "out.h5").exists()
