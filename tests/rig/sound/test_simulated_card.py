"""The rig through PortAudio and a JACK server without hardware, in real time."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("jackd") is None, reason="no jackd here: python3 tools/install.py slow"),
]


def through_portaudio(program: str) -> dict[str, object]:
    """What a program of its own prints as JSON: a server that PortAudio has seen stays with its process."""
    code = f"import json, sys; sys.path.insert(0, {str(ROOT)!r})\n"
    code += f"from tests.rig.sound.through_portaudio import {program} as run; print(json.dumps(run()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return dict(json.loads(done.stdout))


def test_loopback__float32_through_the_audio_path__bit_exact_after_a_constant_delay():
    measured = through_portaudio("loopback")
    assert measured["exact"] == [True] * 6
    assert len(set(measured["delays"])) == 1


def test_server__killed_in_the_middle__one_fault_and_an_end():
    found = through_portaudio("server_killed")
    assert found["fault"] == "CardGone"
    assert "the sound card has stopped" in found["words"]
