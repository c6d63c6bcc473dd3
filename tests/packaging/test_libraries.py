"""Nothing hidden: what runs loads no library but those of its environment, of the interpreter and of the C runtime.

A library of the system that stands in for one that a package lacks goes unnoticed until a machine has none. So the
commands run in processes of their own, in the environment of the wheel, and the kernel tells what each has mapped.
"""

import json
import os
import re
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from websockets.sync.client import connect

from tests.packaging.conftest import RUN_STUDY, Installation
from tests.paper.conftest import STUDY

MAPS = Path("/proc/self/maps")
#: glibc and the runtime of gcc; everything else that the interpreter needs is asked of the interpreter
RUNTIME = re.compile(
    r"(ld-linux.*|lib(c|m|mvec|dl|rt|pthread|util|resolv|nss_(files|dns|compat)|stdc\+\+|gcc_s))\.so[.\d]*"
)
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

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not MAPS.exists(), reason="the kernel tells it in /proc: Linux")]


def libraries(maps: str) -> set[Path]:
    """Every shared library in the text of a process's maps."""
    mapped = {line.split(maxsplit=5)[5].removesuffix(" (deleted)") for line in maps.splitlines() if "/" in line}
    return {Path(os.path.realpath(path)) for path in mapped if re.search(r"\.so(\.|$)", path)}


def environment() -> dict[str, str]:
    """The environment without what would bring in libraries of its own."""
    return {name: value for name, value in os.environ.items() if not name.startswith("LD_")}


def interpreters_own(modules: set[str]) -> set[Path]:
    """What the interpreter itself maps, outside the environment, once it has imported these standard modules."""
    script = f"import {', '.join(['sys', *sorted(modules)])}; print(open('{MAPS}').read())"
    interpreter = [os.path.realpath(sys._base_executable), "-I", "-S", "-c", script]
    done = subprocess.run(interpreter, env=environment(), capture_output=True, text=True, check=True)
    return libraries(done.stdout)


def hidden(maps: str, prefix: Path) -> set[Path]:
    """The libraries that a process of the environment `prefix` has mapped and that nothing there brought along."""
    mapped, base = libraries(maps), os.path.realpath(sys.base_prefix)
    own = {path for path in mapped if path.is_relative_to(os.path.realpath(prefix))}
    own |= {path for path in mapped if RUNTIME.fullmatch(path.name)}
    standard = {path for path in mapped if path.is_relative_to(base) and path.parent.name == "lib-dynload"}
    return mapped - own - interpreters_own({path.name.split(".")[0] for path in standard})


@contextmanager
def server(lab: Installation) -> Iterator[tuple[int, str]]:
    """`experiment serve` on the simulated rig: its process, and the address of the subject's page."""
    (lab.folder / "short.toml").write_text(PROTOCOL)
    serve = ["experiment", "serve", "short.toml", "--store", "lab.db", "--rig", "simulated"]
    serve += ["--controller", "controller.json", "--port", "0", "--speed", "0", "--auto-start"]
    process = subprocess.Popen(
        lab.command(*serve), cwd=lab.folder, env=lab.environment(), stderr=subprocess.PIPE, text=True
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


def test_design__at_its_end__has_loaded_nothing_of_the_system(lab):
    assert hidden(lab.design_maps, lab.prefix) == set()


def test_render__at_its_end__has_loaded_nothing_of_the_system(lab):
    files = ("--out", "reference.wav", "--felt", "felt.h5", "--figures", "felt-figures")
    assert hidden(lab.maps("render", "speech.wav", "--controller", "controller.json", *files), lab.prefix) == set()


def test_reproduce__at_its_end__has_loaded_nothing_of_the_system(lab, pytestconfig):
    assert hidden(lab.maps("reproduce", "--out", "paper", script=RUN_STUDY), lab.prefix) == set()
    pytestconfig.stash[STUDY] = lab.folder / "study.pickle"  # tests/paper need not run it again


def test_server__a_trial_presented__has_loaded_nothing_of_the_system(lab):
    with server(lab) as (process, page):
        present_a_trial(page)
        maps = Path(f"/proc/{process}/maps").read_text()
    assert hidden(maps, lab.prefix) == set()
    assert (lab.folder / "lab.db").exists()


def test_hidden__library_of_the_system__is_named(tmp_path):
    stray = tmp_path / "libstray.so.1"
    (tmp_path / "stray.c").write_text("int stray(void) { return 1; }\n")
    compiler = [os.environ.get("CC") or "cc", "-shared", "-fPIC", "-o", str(stray), str(tmp_path / "stray.c")]
    subprocess.run(compiler, check=True)
    script = f"import ctypes, ssl, sqlite3; ctypes.CDLL('{stray}'); print(open('{MAPS}').read())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert hidden(done.stdout, Path(sys.prefix)) == {stray}
