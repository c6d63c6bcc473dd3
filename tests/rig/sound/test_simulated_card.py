"""The rig through PortAudio and a JACK server without hardware, in real time."""

import json
import os
import shutil
import signal
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


@pytest.fixture(scope="module")
def measured() -> dict[str, object]:
    return through_portaudio("exciter_and_wires")


def test_loopback__float32_through_the_audio_path__bit_exact_after_a_constant_delay(measured):
    assert measured["exact"] == [True] * 6
    assert len(set(measured["delays"])) == 1


def test_demo__kept__is_there_for_other_commands_until_ctrl_c(tmp_path):
    code = "import sys; from tactuator.cli.main import main; from tactuator.verbs import sound\n"
    code += "sound._equalised = lambda *asked: None\n"  # the calibration takes minutes
    code += f"sys.argv = ['tactuator', 'sound', 'demo', '--keep', '--out', {str(tmp_path / 'out')!r}]; sys.exit(main())"
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True) as kept:
        words = kept.stderr.readline().split()
        server = next(word for word in words if word.startswith("JACK_DEFAULT_SERVER=")).rstrip(";")
        device = next(word for word in words if word.startswith("sound:")).removeprefix("sound:")
        environment = dict([*os.environ.items(), server.split("=")], JACK_NO_START_SERVER="1")
        asked = [Path(sys.executable).parent / "tactuator", "sound", "devices", "--json"]
        found = subprocess.run(asked, env=environment, capture_output=True, text=True, timeout=60, check=False)
        kept.send_signal(signal.SIGINT)
        kept.communicate(timeout=60)
    assert kept.returncode == 0
    assert device in [one["name"] for one in json.loads(found.stdout)["devices"]]


def test_multisine__through_the_audio_path__is_the_exciters_truth(measured):
    assert measured["worst_db"] < 0.1
    assert measured["worst_deg"] < 1.0


def test_server__killed_in_the_middle__one_fault_and_an_end():
    found = through_portaudio("server_killed")
    assert found["fault"] == "CardGone"
    assert "the sound card has stopped" in found["words"]


def test_client__stopped_for_a_while__its_gap_is_told():
    found = through_portaudio("client_stopped")
    assert found["told"] == found["provoked"]
