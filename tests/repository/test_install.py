"""The set-up: what it decides, and what it refuses, in one line each. test_fresh_install.py runs it for real."""

import ast
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tools import build, imports, needs, packages, stamps, system

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A tree of its own, with `.venv` as a finished set-up of the test set leaves it."""
    for name in ("requirements", "core", ".venv/bin", ".setup"):
        (tmp_path / name).mkdir(parents=True)
    locks = {name: tmp_path / "requirements" / f"{name}.txt" for name in ("run", "test", "site")}
    for name, path in locks.items():
        path.write_text(f"{name}==1 \\\n    --hash=sha256:00\n")
    (tmp_path / ".venv/bin/python").touch()
    (tmp_path / "setup.py").touch()
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "core/arithmetic").mkdir()
    (tmp_path / "core/arithmetic/section.c").write_text("int a;")
    (tmp_path / "src/tactuator/runtime").mkdir(parents=True)
    (tmp_path / "src/tactuator/runtime/_core_build.py").touch()
    monkeypatch.setattr(stamps, "ROOT", tmp_path)
    monkeypatch.setattr(stamps, "LOCKS", locks)
    monkeypatch.setattr(stamps, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(stamps, "PYTHON", tmp_path / ".venv/bin/python")
    monkeypatch.setattr(stamps, "PACKAGES_STAMP", tmp_path / ".venv/packages.stamp")
    return tmp_path


def stamp(*sets: str) -> dict[str, object]:
    return dict(stamps.built_with(), locks={name: stamps.file_hash(stamps.LOCKS[name]) for name in sets})


@pytest.mark.parametrize(
    ("installed", "asked", "decided"),
    [
        (("run",), "run", (None, "")),
        (("run",), "test", ("test", "add")),
        (("run", "test"), "run", (None, "")),
        (("run", "test"), "test", (None, "")),
        (("run",), "site", ("site", "add")),
        (("run", "test"), "site", ("site", "add")),
        (("run", "test", "site"), "test", (None, "")),
    ],
)
def test_packages_wanted__locks_unchanged__installs_only_what_lacks(tree, installed, asked, decided):
    assert stamps.packages_wanted(asked, stamp(*installed)) == decided


def test_packages_wanted__runtime_lock_changed__keeps_the_larger_set(tree):
    before = stamp("run", "test")
    stamps.LOCKS["run"].write_text("numpy==2")
    assert stamps.packages_wanted("run", before) == ("test", "anew")
    assert stamps.packages_wanted("site", before) == ("site", "anew")


def test_packages_wanted__test_lock_changed__does_not_concern_the_runtime(tree):
    before = stamp("run", "test")
    stamps.LOCKS["test"].write_text("pytest==2")
    assert stamps.packages_wanted("run", before) == (None, "")
    assert stamps.packages_wanted("test", before) == ("test", "anew")


def test_packages_wanted__test_set_broken_off__keeps_the_runtime_set_and_starts_the_test_set_anew(tree):
    stamps.write_packages_stamp("run", adding=True)
    assert stamps.packages_wanted("run", stamps.read_stamp()) == (None, "")
    assert stamps.packages_wanted("test", stamps.read_stamp()) == ("test", "anew")


@pytest.mark.parametrize("lost", ["python", "prefix", "root"])
def test_packages_wanted__other_interpreter_or_place__starts_anew(tree, lost):
    assert stamps.packages_wanted("run", dict(stamp("run"), **{lost: "other"})) == ("run", "anew")


def test_packages_wanted__broken_off_before__starts_anew(tree):
    stamps.PACKAGES_STAMP.write_text(json.dumps(stamp("run"))[:20])
    assert stamps.packages_wanted("run", stamps.read_stamp()) == ("run", "anew")


@pytest.mark.parametrize(
    "name", ["core/arithmetic/section.c", "pyproject.toml", "src/tactuator/runtime/_core_build.py"]
)
def test_sources_hash__anything_the_build_reads_changes__changes(tree, name):
    before = stamps.sources_hash()
    (tree / name).write_text("other")
    assert stamps.sources_hash() != before


def test_sources_hash__header_added_or_renamed__changes(tree):
    hashes = {stamps.sources_hash()}
    (tree / "core/new.h").write_text("")
    hashes.add(stamps.sources_hash())
    (tree / "core/new.h").rename(tree / "core/newer.h")
    hashes.add(stamps.sources_hash())
    assert len(hashes) == 3


def test_core_modules__wherever_the_script_lies__beside_it(tree):
    assert build.core_modules() == ["tactuator.runtime._core"]
    (tree / "src/tactuator/runtime").rename(tree / "src/tactuator/elsewhere")
    assert build.core_modules() == ["tactuator.elsewhere._core"]


def test_needs__nothing_there__all_is_named_in_one_line(monkeypatch, tmp_path):
    monkeypatch.setenv("CC", "no-such-compiler -O2")
    monkeypatch.setattr(needs.importlib.util, "find_spec", lambda module: None)
    monkeypatch.setattr(needs.sysconfig, "get_path", lambda name: str(tmp_path))
    with pytest.raises(SystemExit) as refused:
        needs.check()
    said = str(refused.value)
    assert "\n" not in said
    assert "venv module with pip; Python's C headers (Python.h); a C compiler (no 'no-such-compiler'" in said
    assert said.endswith("apt-get install python3-venv python3-dev gcc")


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (
            "echo 'try.c:1: fatal error: stdlib.h: No such file' >&2; echo more >&2; exit 1",
            "stdlib.h: No such file. On",
        ),
        ("exit 1", "it says nothing. On"),
        ("exec /no/such/loader", "loader: not found. On"),
    ],
)
def test_needs__compiler_that_cannot_compile__is_told_in_one_line(monkeypatch, tmp_path, script, words):
    compiler = tmp_path / "cc"
    compiler.write_text(f"#!/bin/sh\n{script}\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    with pytest.raises(SystemExit) as refused:
        needs.check()
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_needs__this_machine__has_all():
    needs.check()


def test_check_room__little_left__is_told_before_anything_is_done(tree, monkeypatch):
    monkeypatch.setattr(needs.shutil, "disk_usage", lambda place: shutil._ntuple_diskusage(10**9, 10**9, 12 * 10**6))
    with pytest.raises(
        SystemExit, match=r"no room for \.venv: it needs about 450 MB, and the disk of .* has 12 MB free"
    ):
        needs.check_room("run")


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device\n",
         "no room left on the disk; free now: "),
        ("Collecting numpy==2.4.6\nERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE. If\n"
         "    numpy==2.4.6 from https://a.example/numpy.whl:\n        Expected sha256 00\n",
         "a file for numpy==2.4.6 is not the one"),
        ("WARNING: Retrying (Retry(total=0)) after connection broken by 'NewConnectionError('<HTTPConnection object>:"
         " Failed to establish a new connection: [Errno 111] Connection refused')': /simple/cffi/\nERROR: Could not "
         "find a version that satisfies cffi==2.1.1\nERROR: No matching distribution found for cffi==2.1.1\n",
         "the package index cannot be reached (NewConnectionError)"),
        ("ERROR: Could not find a version that satisfies the requirement scipy==1.17.1 (from versions: none)\n"
         "ERROR: No matching distribution found for scipy==1.17.1\n",
         "offers no file of scipy==1.17.1 for Python 3."),
        ("WARNING: The repository located at a.example is not a trusted or secure host and is being ignored.\nERROR: "
         "No matching distribution found for a==1\n", "cannot be reached (not a trusted or secure host)"),
        ("Collecting a==1\nERROR: Can not perform a '--user' install.\n", "Can not perform a '--user' install."),
        ("", "nothing was said"),
    ],
)  # fmt: skip
def test_explained__whatever_pip_says__is_one_line_and_all_of_it_is_kept(tree, said, words):
    line = packages.explained(said, "not installed")
    assert line.startswith("not installed: ")
    assert words in line
    assert "\n" not in line
    assert (tree / ".setup/failed.log").read_text() == said


def test_install__python_too_old__is_told_in_one_sentence():
    script = "import sys, runpy; sys.version_info = (3, 9, 2); runpy.run_path('tools/install.py', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("tactuator needs Python 3.11 or later; ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("feature_version", [(3, 4), (3, 7)])
def test_install__syntax__is_old_enough_to_be_told(feature_version):
    text = (ROOT / "tools/install.py").read_text(encoding="ascii")
    ast.parse(text, feature_version=feature_version)
    assert "print(" not in text  # nor does Python 2 stumble before it is told


def test_imports__every_runtime_dependency__can_be_imported_here():
    assert "from scipy import signal" in imports.imports_in_sources()["scipy"]
    assert {"numpy", "SQLAlchemy", "soundfile"} <= set(imports.dependencies())
    assert (
        imports.failure(["import json", "import no_such_module"])
        == "ModuleNotFoundError: No module named 'no_such_module'"
    )
    assert imports.failure(["import os; os.kill(os.getpid(), 4)"]) == "the process ended by SIGILL"
    assert imports.failure(["import json", "import soundfile"]) == ""


def test_system__not_root__says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr(system.os, "geteuid", lambda: 1000)
    monkeypatch.setattr(system.shutil, "which", lambda command: None)
    monkeypatch.setattr(sys, "argv", ["system.py", "boards"])
    with pytest.raises(SystemExit, match="apt-get install gcc-arm-none-eabi qemu-system-arm"):
        system.main()


def test_system__nothing_missing__does_nothing(monkeypatch):
    monkeypatch.setattr(system.shutil, "which", lambda command: f"/bin/{command}")
    monkeypatch.setattr(sys, "argv", ["system.py", "test"])
    system.main()
