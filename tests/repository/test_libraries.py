"""Nothing hidden: what runs loads no library but those of `.venv`, of the interpreter and of the C and C++ runtime.

A library of the system that stands in for one that a package lacks goes unnoticed until a machine has none. So the
commands run in processes of their own, and the kernel tells what each has mapped.
"""

import json
import math
import os
import re
import struct
import subprocess
import sys
import urllib.request
import wave
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from websockets.sync.client import connect

ROOT = Path(__file__).resolve().parents[2]
MAPS = Path("/proc/self/maps")
#: glibc and the runtime of gcc; everything else that the interpreter needs is asked of the interpreter
RUNTIME = re.compile(
    r"(ld-linux.*|lib(c|m|mvec|dl|rt|pthread|util|resolv|nss_(files|dns|compat)|stdc\+\+|gcc_s))\.so[.\d]*"
)
RUN = """
import atexit, pathlib, sys
told = pathlib.Path(sys.argv[1])
atexit.register(lambda: told.write_text(pathlib.Path("/proc/self/maps").read_text()))
from tactuator.cli.main import main
sys.exit(main(sys.argv[2:]))
"""
DISPLAY = """
[display]
rate_hz = 4000

[[channel]]
name = "index"
sensor_gain_v_per_mm = 0.19898
travel_mm = 12.5
plant = { num = [2875.0], den = [1.0, 94.0, 290.0] }
"""
PROTOCOL = """
[study]
name = "libraries"
consent = "You may stop at any time."
seed = 1

[procedure]
kind = "imece2004"

[conditions]
fingers = ["index"]
frequencies_hz = [50]

[[subject]]
code = "S1"
"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not MAPS.exists(), reason="the kernel tells it in /proc: Linux"),
]


def libraries(maps: str) -> set[Path]:
    """Every shared library in the text of a process's maps."""
    mapped = {line.split(maxsplit=5)[5].removesuffix(" (deleted)") for line in maps.splitlines() if "/" in line}
    return {Path(os.path.realpath(path)) for path in mapped if re.search(r"\.so(\.|$)", path)}


def environment() -> dict[str, str]:
    """The environment without what would bring in libraries of its own."""
    return {name: value for name, value in os.environ.items() if not name.startswith("LD_")}


def interpreters_own(modules: set[str]) -> set[Path]:
    """What the interpreter itself maps, outside `.venv`, once it has imported these modules of its standard library."""
    script = f"import {', '.join(['sys', *sorted(modules)])}; print(open('{MAPS}').read())"
    interpreter = [os.path.realpath(sys._base_executable), "-I", "-S", "-c", script]
    done = subprocess.run(interpreter, env=environment(), capture_output=True, text=True, check=True)
    return libraries(done.stdout)


def hidden(maps: str) -> set[Path]:
    """The libraries that a process has mapped and that nothing here brought along."""
    mapped, base = libraries(maps), os.path.realpath(sys.base_prefix)
    own = {path for path in mapped if path.is_relative_to(os.path.realpath(sys.prefix))}
    own |= {path for path in mapped if path.is_relative_to(ROOT / "src") and path.name.startswith("_core")}
    own |= {path for path in mapped if RUNTIME.fullmatch(path.name)}
    standard = {path for path in mapped if path.is_relative_to(base) and path.parent.name == "lib-dynload"}
    return mapped - own - interpreters_own({path.name.split(".")[0] for path in standard})


def command(folder: Path, *arguments: str) -> list[str]:
    return [sys.executable, "-c", RUN, str(folder / "maps"), *arguments]


def mapped_by(folder: Path, *arguments: str) -> str:
    """Run a command and return what its process had mapped at its end."""
    done = subprocess.run(
        command(folder, *arguments), cwd=folder, env=environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return (folder / "maps").read_text()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A display, a controller for it, a protocol, and a second of sound."""
    made = tmp_path_factory.mktemp("libraries")
    (made / "display.toml").write_text(DISPLAY)
    (made / "protocol.toml").write_text(PROTOCOL)
    with wave.open(str(made / "speech.wav"), "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(2)
        sound.setframerate(16000)
        sound.writeframes(b"".join(struct.pack("<h", int(9000 * math.sin(0.1 * n))) for n in range(16000)))
    mapped_by(made, "design", "display.toml", "--out", "controller.json")
    return made


@contextmanager
def server(folder: Path) -> Iterator[tuple[int, str]]:
    """`experiment serve` on the simulated rig: its process, and the address of the subject's page."""
    serve = ["experiment", "serve", "protocol.toml", "--store", "lab.db", "--rig", "simulated"]
    serve += ["--controller", "controller.json", "--port", "0", "--speed", "0", "--auto-start"]
    process = subprocess.Popen(
        command(folder, *serve), cwd=folder, env=environment(), stderr=subprocess.PIPE, text=True
    )  # fmt: skip
    try:
        said = []
        for line in process.stderr:
            said.append(line)
            if found := re.search(r"http://\S*/s/\S+", line):
                yield process.pid, found[0]
                break
        else:
            pytest.fail("the server ended: " + "".join(said))
    finally:
        process.terminate()
        process.communicate(timeout=30)


def present_a_trial(page: str) -> None:
    """Be the subject until the first answer is asked for: the store, the rig and the sockets have been used by then."""
    assert urllib.request.urlopen(page, timeout=30).status == 200
    with connect(page.replace("http:", "ws:").replace("/s/", "/ws/subject/")) as socket:

        def until(kind: str) -> None:
            while json.loads(socket.recv(timeout=60))["type"] != kind:
                pass

        until("stage")
        socket.send(json.dumps({"type": "consent"}))
        until("stage")
        socket.send(json.dumps({"type": "ready", "stage": "trial"}))
        until("answer-now")


@pytest.mark.parametrize(
    "arguments",
    [
        ("design", "display.toml", "--out", "again.json", "--figures", "figures"),
        ("render", "speech.wav", "--controller", "controller.json", "--out", "reference.wav",
         "--felt", "felt.h5", "--figures", "felt-figures"),
        ("reproduce", "--speech", "speech.wav", "--out", "paper"),
    ],
    ids=lambda arguments: arguments[0],
)  # fmt: skip
def test_command__at_its_end__has_loaded_nothing_of_the_system(folder, arguments):
    assert hidden(mapped_by(folder, *arguments)) == set()


def test_server__a_trial_presented__has_loaded_nothing_of_the_system(folder):
    with server(folder) as (process, page):
        present_a_trial(page)
        maps = Path(f"/proc/{process}/maps").read_text()
    assert hidden(maps) == set()


def test_hidden__library_of_the_system__is_named(tmp_path):
    stray = tmp_path / "libstray.so.1"
    (tmp_path / "stray.c").write_text("int stray(void) { return 1; }\n")
    compiler = [os.environ.get("CC") or "cc", "-shared", "-fPIC", "-o", str(stray), str(tmp_path / "stray.c")]
    subprocess.run(compiler, check=True)
    script = f"import ctypes, ssl, sqlite3; ctypes.CDLL('{stray}'); print(open('{MAPS}').read())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert hidden(done.stdout) == {stray}
