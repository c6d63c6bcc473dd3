"""`tactuator firmware stream`: what it says, and its exit status."""

import json

import pytest

from tactuator.cli import main
from tactuator.io.controller import write_controller
from tests.rig.guard.guarded import designed


@pytest.fixture(scope="module")
def stream(tmp_path_factory):
    controller = tmp_path_factory.mktemp("stream") / "controller.json"
    write_controller(controller, designed())
    return lambda *more: main(["firmware", "stream", "--controller", str(controller), "--seconds", "0.2", *more])


def test_stream__fast_enough__exits_0_with_one_object(stream, capsys):
    assert stream("--instruction-ns", "4", "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["holds"]
    assert said["bit_exact"]
    assert (said["board"], said["channels"], said["samples"], said["played"]) == ("mps2-an500", 3, 800, 800)
    assert (said["late"], said["dry"], said["dropped"], said["fault"]) == (0, 0, 0, "none")
    # twelve bytes a sample there and twice that back is the least there can be
    assert said["to_board_bytes_per_s"] * said["board_s"] > 12 * 800
    assert said["from_board_bytes_per_s"] * said["board_s"] > 24 * 800


def test_stream__far_too_slow_a_processor__exits_1(stream, capsys):
    assert stream("--instruction-ns", "256") == 1
    assert "late" in capsys.readouterr().out


@pytest.mark.parametrize("more", [["--instruction-ns", "3"], ["--board", "toaster"], ["--seconds", "0"]])
def test_stream__asked_for_what_cannot_be__exits_2_in_one_line(stream, capsys, more):
    assert stream(*more) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert len(told.err.splitlines()) == 1
    assert "allowed" in told.err
