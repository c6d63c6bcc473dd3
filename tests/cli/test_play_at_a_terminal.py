"""`tactuator play` at a terminal: keys, and Ctrl-C, which every process of the terminal hears."""

import json
import os
import pty
import select
import sys
import time

import numpy as np
import pytest

from tactuator.io.controller import write_controller
from tactuator.io.reference import ReferenceHead, write_reference
from tests.rig.guard.guarded import designed

LONGEST_S = 120.0


def at_a_terminal(arguments, out, key):
    """Exit status and what was said; `key` is pressed once the progress shows that something has been played."""
    child, terminal = pty.fork()
    if child == 0:
        os.dup2(os.open(out, os.O_CREAT | os.O_WRONLY), 1)
        code = "import sys; from tactuator.cli import main; sys.exit(main(sys.argv[1:]))"
        os.execv(sys.executable, [sys.executable, "-c", code, *arguments])
    said, pressed, end = b"", False, time.monotonic() + LONGEST_S
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.1)[0]:
            try:
                said += os.read(terminal, 1 << 16)
            except OSError:  # nobody is left at the other end
                break
        if not pressed and b"play" in said:
            time.sleep(0.5)
            os.write(terminal, key)
            pressed = True
    _, status = os.waitpid(child, 0)
    os.close(terminal)
    return os.waitstatus_to_exitcode(status), said.decode(errors="replace")


@pytest.mark.parametrize(("rig", "key"), [("simulated", b"q"), ("emulated:mps2-an500", b"\x03")])
def test_play__stopped_at_the_terminal__ramps_down_and_says_how_far_it_came(tmp_path, rig, key):
    made = designed()
    names = tuple(channel.name for channel in made.display.channels)
    write_controller(tmp_path / "c.json", made)
    with write_reference(tmp_path / "r.h5", ReferenceHead(made.rate_hz, names)) as writer:
        writer.write(np.full((80000, 3), 10.0))
    arguments = ["play", str(tmp_path / "r.h5"), "--controller", str(tmp_path / "c.json"), "--rig", rig]
    status, said = at_a_terminal([*arguments, "--realtime", "--json"], tmp_path / "out.json", key)
    assert status == 130, said
    played = json.loads((tmp_path / "out.json").read_text())
    assert played["stopped"]
    assert 0.1 < played["played_s"] < 20.0
    assert "interrupted" in said.splitlines()[-1]
