"""The wheel: built as `make wheel` does, installed where there is neither compiler nor checkout, and used there.

What runs loads no library but those of its environment, of the interpreter and of the C runtime: one of the system that
stands in for one that a package lacks goes unnoticed until a machine has none. The kernel tells what a process has
mapped. All is made once, in one worker (tests/conftest.py).
"""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import distribution
from importlib.util import cache_from_source
from pathlib import Path

import pytest
from websockets.sync.client import connect

from tactuator.rig.boards import BOARDS, build_firmware
from tools import wheel as maker

ROOT = Path(__file__).resolve().parents[2]
MAPS = Path("/proc/self/maps")
#: glibc and the runtime of gcc; everything else that the interpreter needs is asked of the interpreter
RUNTIME = re.compile(
    r"(ld-linux.*|lib(c|m|mvec|dl|rt|pthread|util|resolv|nss_(files|dns|compat)|stdc\+\+|gcc_s))\.so[.\d]*"
)
#: Runs commands one after the other as the program does, and writes the libraries that its process has mapped.
RUN = """
import json, pathlib, sys
from tactuator.cli.main import main
ended = [main(words) for words in json.loads(sys.argv[2])]
pathlib.Path(sys.argv[1]).write_text(pathlib.Path("/proc/self/maps").read_text())
sys.exit(max(ended))
"""
CHAIN = (
    "init --examples .",
    "identify sheet.csv --out model.json",
    "design displays/tactuator.toml --out controller.json",
    "check controller.json --json",
    "render speech.wav --controller controller.json --out r.wav --felt felt.h5 --figures felt-figures",
)
SERVE = "experiment serve protocol.toml --store lab.db --rig simulated --controller controller.json --port 0 --speed 0"


class Installation:
    """The program as the wheel installs it, where there is no compiler, no checkout and no other package."""

    def __init__(self, environment: Path, folder: Path) -> None:
        self.prefix, self.folder = environment, folder
        self.python = str(environment / "bin" / "python")

    def environment(self, more_path: Path | None = None) -> dict[str, str]:
        """Only the folder of the installed programs is on the path, and what a test adds."""
        path = [str(self.prefix / "bin"), *([str(more_path)] if more_path else [])]
        return {"PATH": os.pathsep.join(path), "HOME": str(self.folder), "OPENBLAS_NUM_THREADS": "1"}

    def run(self, *command: str, path: Path | None = None) -> str:
        """Run a program in the folder, and return what it printed when it has ended well."""
        where = {"cwd": self.folder, "env": self.environment(path)}
        done = subprocess.run(command, **where, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout


def _link_runtime_set(target: Path) -> None:
    """Link the packages of the runtime lock from this environment, where pip installed them at the same versions.

    A link needs no room, and a module keeps what was compiled of it.
    """
    packages = Path(sysconfig.get_paths()["purelib"])
    lock = (ROOT / "requirements" / "run.txt").read_text(encoding="ascii")
    for name, version in re.findall(r"^(\S+)==(\S+) ", lock, re.MULTILINE):
        assert distribution(name).version == version
        files = [str(file) for file in distribution(name).files or () if ".." not in file.parts]
        for file in [*files, *(cache_from_source(file) for file in files if file.endswith(".py"))]:
            if (packages / file).exists():
                (target / file).parent.mkdir(parents=True, exist_ok=True)
                try:
                    (target / file).hardlink_to(packages / file)
                except OSError:  # another file system
                    shutil.copy2(packages / file, target / file)


@pytest.fixture(scope="module")
def installation(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Installation]:
    """The wheel, built and installed with the runtime set; its folder is empty."""
    place = tmp_path_factory.mktemp("wheel")
    maker.main()
    (wheel,) = maker.DIST.glob("*-cp311-abi3-*.whl")
    environment = place / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    _link_runtime_set(next(environment.glob("lib/python3*/site-packages")))
    pip = [sys.executable, "-m", "pip", "--python", environment, "install", "--quiet", "--no-compile"]
    subprocess.run([*pip, "--no-deps", "--no-index", wheel], check=True)
    (place / "folder").mkdir()
    yield Installation(environment, place / "folder")
    shutil.rmtree(place, ignore_errors=True)


@pytest.fixture(scope="module")
def chain(installation: Installation) -> str:
    """What the chain of commands from an empty folder printed; their files and their maps are in the folder."""
    commands = json.dumps([words.split() for words in CHAIN])
    return installation.run(installation.python, "-c", RUN, "maps", commands)


def libraries(maps: str) -> set[Path]:
    """Every shared library in the text of a process's maps."""
    mapped = {line.split(maxsplit=5)[5].removesuffix(" (deleted)") for line in maps.splitlines() if "/" in line}
    return {Path(os.path.realpath(path)) for path in mapped if re.search(r"\.so(\.|$)", path)}


def interpreters_own(modules: set[str]) -> set[Path]:
    """What the interpreter itself maps, outside the environment, once it has imported these standard modules."""
    script = f"import {', '.join(['sys', *sorted(modules)])}; print(open('{MAPS}').read())"
    interpreter = [os.path.realpath(sys._base_executable), "-I", "-S", "-c", script]
    bare = {name: value for name, value in os.environ.items() if not name.startswith("LD_")}
    return libraries(subprocess.run(interpreter, env=bare, capture_output=True, text=True, check=True).stdout)


def hidden(maps: str, prefix: Path) -> set[Path]:
    """The libraries that a process of the environment `prefix` has mapped and that nothing there brought along."""
    mapped, base = libraries(maps), os.path.realpath(sys.base_prefix)
    known = {path for path in mapped if path.is_relative_to(os.path.realpath(prefix))}
    known |= {path for path in mapped if RUNTIME.fullmatch(path.name)}
    standard = {path for path in mapped if path.is_relative_to(base) and path.parent.name == "lib-dynload"}
    return mapped - known - interpreters_own({path.name.split(".")[0] for path in standard})


@contextmanager
def server(lab: Installation) -> Iterator[tuple[int, str]]:
    """`experiment serve` on the simulated rig: its process, and the address of the subject's page."""
    command = [lab.python, "-m", "tactuator", *SERVE.split(), "--auto-start"]
    process = subprocess.Popen(command, cwd=lab.folder, env=lab.environment(), stderr=subprocess.PIPE, text=True)
    try:
        said = []
        for line in process.stderr:
            said.append(line)
            if address := re.search(r"http://\S*/s/\S+", line):
                yield process.pid, address[0]
                break
        else:
            pytest.fail("the server ended: " + "".join(said))
    finally:
        process.terminate()
        process.communicate(timeout=30)


def present_a_trial(page: str) -> None:
    """Be the subject until the first answer is asked for: the store, the rig and the sockets have been used by then."""
    assert urllib.request.urlopen(page, timeout=30).status == 200
    message: dict[str, str] = {"type": ""}
    with connect(page.replace("http:", "ws:").replace("/s/", "/ws/subject/")) as socket:
        while message["type"] != "answer-now":
            message = json.loads(socket.recv(timeout=60))
            if message["type"] == "stage":
                stage = message["stage"]
                answer = {"type": "consent"} if stage == "consent" else {"type": "ready", "stage": stage}
                socket.send(json.dumps(answer))


in_proc = pytest.mark.skipif(not MAPS.exists(), reason="the kernel tells it in /proc: Linux")


@pytest.mark.slow
@in_proc
def test_wheel__chain_from_an_empty_folder__meets_its_objectives_and_has_loaded_nothing_of_the_system(
    installation: Installation, chain: str
) -> None:
    (verdict,) = (json.loads(line) for line in chain.splitlines() if line.startswith("{"))
    assert verdict["outcome"] == "met"
    assert hidden((installation.folder / "maps").read_text(), installation.prefix) == set()


@pytest.mark.slow
@in_proc
def test_wheel__server_a_trial_presented__has_loaded_nothing_of_the_system(installation, chain) -> None:
    with server(installation) as (process, page):
        present_a_trial(page)
        maps = Path(f"/proc/{process}/maps").read_text()
    assert hidden(maps, installation.prefix) == set()
    assert (installation.folder / "lab.db").exists()


@in_proc
def test_hidden__library_of_the_system__is_named(tmp_path):
    stray = tmp_path / "libstray.so.1"
    (tmp_path / "stray.c").write_text("int stray(void) { return 1; }\n")
    compiler = [os.environ.get("CC") or "cc", "-shared", "-fPIC", "-o", str(stray), str(tmp_path / "stray.c")]
    subprocess.run(compiler, check=True)
    script = f"import ctypes, ssl, sqlite3; ctypes.CDLL('{stray}'); print(open('{MAPS}').read())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert hidden(done.stdout, Path(sys.prefix)) == {stray}


@pytest.mark.slow
def test_wheel__installed__has_the_pages_as_they_are_and_neither_compiler_nor_checkout(installation) -> None:
    script = "import hashlib, pathlib, shutil, tactuator; root = pathlib.Path(tactuator.__file__).parent\n"
    script += "print(root, shutil.which('gcc'), shutil.which('cc'))\n"
    script += "for p in root.glob('*/static/*'): print(hashlib.sha256(p.read_bytes()).hexdigest(), p.relative_to(root))"
    (folder, *compilers), *parts = map(str.split, installation.run(installation.python, "-c", script).splitlines())
    assert Path(folder).is_relative_to(installation.prefix)
    assert compilers == ["None", "None"]
    package = ROOT / "src" / "tactuator"
    here = {str(p.relative_to(package)): hashlib.sha256(p.read_bytes()).hexdigest() for p in package.glob("*/static/*")}
    assert {name: digest for digest, name in parts} == here
    assert len([name for name in here if name.startswith("console/static/")]) > 20


@pytest.mark.slow
def test_wheel__with_the_cross_compiler__builds_the_firmware_from_its_own_sources(installation, tmp_path) -> None:
    for name in ("gcc", "objcopy", "size"):
        (tmp_path / f"arm-none-eabi-{name}").symlink_to(shutil.which(f"arm-none-eabi-{name}") or "")
    words = ["firmware", "program", "--board", "stm32f405", "--out", "f.bin", "--json"]
    out = installation.run(str(installation.prefix / "bin" / "tactuator"), *words, path=tmp_path)
    assert json.loads(out)["flash_bytes"] > 10_000


@pytest.mark.slow
@pytest.mark.parametrize("emulated", [True, False])
def test_firmware__of_every_board__compiles_without_a_warning(emulated):
    for name in [name for name, board in BOARDS.items() if emulated or board.is_real]:
        assert build_firmware(name, emulated).with_suffix(".txt").read_text() == ""


def test_wheel__platform_that_is_older_than_is_needed_or_that_is_none__is_refused(monkeypatch, tmp_path):
    with monkeypatch.context() as patch:
        patch.setattr(maker, "policy", lambda path: "manylinux_2_34_x86_64")
        maker.require_tag(tmp_path, "manylinux_2_34_x86_64")
        with pytest.raises(SystemExit, match="keep to manylinux_2_34_x86_64, and its name says manylinux_2_17_x86_64"):
            maker.require_tag(tmp_path, "manylinux_2_17_x86_64")
    monkeypatch.setattr(maker, "auditor", lambda: "echo")
    with pytest.raises(SystemExit, match="names no platform"):
        maker.policy("none.whl")
