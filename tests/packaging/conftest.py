"""An environment that holds the wheel and the runtime set and nothing else, and a folder in which it was used.

Both are made once, and every test that needs them is run by one worker (tests/conftest.py).
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from importlib.metadata import distribution
from importlib.util import cache_from_source
from pathlib import Path

import pytest

from tools import wheel as maker

ROOT = Path(__file__).resolve().parents[2]
#: Runs a command as the program does, and writes the libraries that its process has mapped at its end.
RUN = """
import atexit, pathlib, sys
told = pathlib.Path(sys.argv[1])
atexit.register(lambda: told.write_text(pathlib.Path("/proc/self/maps").read_text()))
from tactuator.cli.main import main
sys.exit(main(sys.argv[2:]))
"""
#: The same of `reproduce`, which also leaves its study in a file.
RUN_STUDY = (
    """
import pathlib, pickle, sys
from tactuator.paper import run as reproduce
run_study = reproduce.run_study
def kept(*asked):
    study = run_study(*asked)
    pathlib.Path("study.pickle").write_bytes(pickle.dumps(study))
    return study
reproduce.run_study = kept
"""
    + RUN
)


class Installation:
    """The program as the wheel installs it, where there is no compiler, no checkout and no other package."""

    def __init__(self, environment: Path, folder: Path) -> None:
        self.prefix, self.folder = environment, folder
        self.design_maps = ""

    def environment(self, more_path: Path | None = None) -> dict[str, str]:
        """Only the folder of the installed programs is on the path, and what a test adds."""
        path = [str(self.prefix / "bin"), *([str(more_path)] if more_path else [])]
        return {"PATH": os.pathsep.join(path), "HOME": str(self.folder), "OPENBLAS_NUM_THREADS": "1"}

    def run(self, *words: str, path: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run `tactuator` in the folder, and return what it said when it has ended well."""
        return self._ended_well([str(self.prefix / "bin" / "tactuator"), *words], path)

    def maps(self, *words: str, script: str = RUN) -> str:
        """Run `tactuator` in the folder, and return what its process had mapped at its end."""
        self._ended_well(self.command(*words, script=script), None)
        return (self.folder / "maps").read_text()

    def command(self, *words: str, script: str = RUN) -> list[str]:
        """The command that also writes the maps."""
        return [str(self.prefix / "bin" / "python"), "-c", script, str(self.folder / "maps"), *words]

    def _ended_well(self, command: list[str], path: Path | None) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            command, cwd=self.folder, env=self.environment(path), capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done


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


@pytest.fixture(scope="session")
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


@pytest.fixture(scope="session")
def lab(installation: Installation) -> Installation:
    """The same with the examples in its folder, the model of a response, and the controller of a display."""
    installation.run("init", "--examples", ".")
    installation.run("identify", "sheet.csv", "--out", "model.json")
    installation.design_maps = installation.maps("design", "displays/tactuator.toml", "--out", "controller.json")
    return installation
