"""The wheel: built as `make wheel` does, installed where there is neither compiler nor checkout, and used there.

All is made once, in one worker (tests/conftest.py).
"""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from collections.abc import Iterator
from importlib.metadata import distribution
from importlib.util import cache_from_source
from pathlib import Path

import pytest

from tools import wheel as maker

ROOT = Path(__file__).resolve().parents[2]
CHAIN = (
    "init --examples .",
    "identify bench.csv --input drive --output encoder --time t --order 2 --zeros 0 --out model.json",
    "design bench.toml --out controller.json",
    "render speech.wav --controller controller.json --out r.wav --felt felt.h5 --figures felt-figures",
    "check controller.json --json",
)


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


@pytest.mark.slow
def test_packages_list__beside_the_wheel__has_the_runtime_lock_with_versions_and_licences(installation) -> None:
    (path,) = maker.DIST.glob("*.cdx.json")
    text = path.read_text(encoding="utf-8")
    document = json.loads(text)
    lock = dict(re.findall(r"^([\w.-]+)==(\S+)", maker.RUNTIME.read_text(encoding="ascii"), re.MULTILINE))
    del lock["setuptools"]
    listed = {re.sub("[-_.]+", "-", part["name"]).lower(): part for part in document["components"]}
    assert {name: part["version"] for name, part in listed.items()} == lock
    assert [name for name, part in listed.items() if not part.get("licenses")] == []
    assert document["metadata"]["component"]["name"] == "tactuator"
    assert (document["bomFormat"], "timestamp" in text, str(ROOT) in text) == ("CycloneDX", False, False)


@pytest.mark.slow
def test_wheel_and_sdist__built_twice__are_the_same_bytes_without_a_path_of_this_machine(installation) -> None:
    first = {path.name: path.read_bytes() for path in maker.DIST.glob("tactuator-*") if path.suffix != ".part"}
    maker.main()
    assert len(first) >= 3
    assert {name: (maker.DIST / name).read_bytes() for name in first} == first
    wheel = next(path for path in maker.DIST.glob("*-cp311-abi3-*.whl"))
    with zipfile.ZipFile(wheel) as archive:
        binary = archive.read(next(name for name in archive.namelist() if name.endswith(".so")))
    assert b"tactuator-wheel-" not in binary
    assert str(ROOT).encode() not in binary


@pytest.mark.slow
def test_wheel__chain_from_an_empty_folder__meets_its_objectives(installation: Installation) -> None:
    for words in CHAIN:
        said = installation.run(installation.python, "-m", "tactuator", *words.split())
    assert json.loads(said)["outcome"] == "met"


@pytest.mark.slow
def test_wheel__installed__has_the_pages_as_they_are(installation) -> None:
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


def test_wheel__platform_that_is_older_than_is_needed_or_that_is_none__is_refused(monkeypatch, tmp_path):
    with monkeypatch.context() as patch:
        patch.setattr(maker, "policy", lambda path: "manylinux_2_34_x86_64")
        maker.require_tag(tmp_path, "manylinux_2_34_x86_64")
        with pytest.raises(SystemExit, match="keep to manylinux_2_34_x86_64, and its name says manylinux_2_17_x86_64"):
            maker.require_tag(tmp_path, "manylinux_2_17_x86_64")
    monkeypatch.setattr(maker, "tool", lambda name: "echo")
    with pytest.raises(SystemExit, match="names no platform"):
        maker.policy("none.whl")
