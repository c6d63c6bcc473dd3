"""The set-up: what it decides, what it refuses, what it hands to uv."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tools import install, system

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A tree of its own, with `.venv` as a finished set-up of the test set leaves it."""
    for name in ("requirements", "core", ".venv/bin"):
        (tmp_path / name).mkdir(parents=True)
    locks = {name: tmp_path / "requirements" / f"{name}.txt" for name in ("run", "test")}
    for name, path in locks.items():
        path.write_text(
            f"{name}==1 \\\n    --hash=sha256:00\nuv==2 \\\n    --hash=sha256:11 \\\n    --hash=sha256:22\n"
        )
    (tmp_path / ".venv/bin/python").touch()
    (tmp_path / "setup.py").touch()
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "core/arithmetic").mkdir()
    (tmp_path / "core/arithmetic/section.c").write_text("int a;")
    (tmp_path / "src/tactuator/runtime").mkdir(parents=True)
    (tmp_path / "src/tactuator/runtime/_core_build.py").touch()
    monkeypatch.setattr(install, "ROOT", tmp_path)
    monkeypatch.setattr(install, "LOCKS", locks)
    monkeypatch.setattr(install, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(install, "PYTHON", tmp_path / ".venv/bin/python")
    monkeypatch.setattr(install, "PACKAGES_STAMP", tmp_path / ".venv/packages.stamp")
    return tmp_path


def stamp(*sets: str) -> dict[str, object]:
    return dict(install.built_with(), locks={name: install.file_hash(install.LOCKS[name]) for name in sets})


@pytest.mark.parametrize(
    ("installed", "asked", "decided"),
    [
        (("run",), "run", (None, "")),
        (("run",), "test", ("test", "add")),
        (("run", "test"), "run", (None, "")),
        (("run", "test"), "test", (None, "")),
    ],
)
def test_packages_wanted__locks_unchanged__installs_only_what_lacks(tree, installed, asked, decided):
    assert install.packages_wanted(asked, stamp(*installed)) == decided


def test_packages_wanted__runtime_lock_changed__keeps_the_larger_set(tree):
    before = stamp("run", "test")
    install.LOCKS["run"].write_text("numpy==2")
    assert install.packages_wanted("run", before) == ("test", "sync")


def test_packages_wanted__test_lock_changed__does_not_concern_the_runtime(tree):
    before = stamp("run", "test")
    install.LOCKS["test"].write_text("pytest==2")
    assert install.packages_wanted("run", before) == (None, "")
    assert install.packages_wanted("test", before) == ("test", "sync")


@pytest.mark.parametrize("lost", ["python", "prefix", "root"])
def test_packages_wanted__other_interpreter_or_place__starts_anew(tree, lost):
    assert install.packages_wanted("run", dict(stamp("run"), **{lost: "other"})) == ("run", "anew")


def test_packages_wanted__broken_off_before__starts_anew(tree):
    install.PACKAGES_STAMP.write_text(json.dumps(stamp("run"))[:20])
    assert install.packages_wanted("run", install.read_stamp()) == ("run", "anew")


@pytest.mark.parametrize(
    "name", ["core/arithmetic/section.c", "pyproject.toml", "src/tactuator/runtime/_core_build.py"]
)
def test_sources_hash__anything_the_build_reads_changes__changes(tree, name):
    before = install.sources_hash()
    (tree / name).write_text("other")
    assert install.sources_hash() != before


def test_sources_hash__header_added_or_renamed__changes(tree):
    hashes = {install.sources_hash()}
    (tree / "core/new.h").write_text("")
    hashes.add(install.sources_hash())
    (tree / "core/new.h").rename(tree / "core/newer.h")
    hashes.add(install.sources_hash())
    assert len(hashes) == 3


def test_locked__one_package__comes_with_all_its_hashes(tree):
    expected = "uv==2 \\\n    --hash=sha256:11 \\\n    --hash=sha256:22\n"
    assert install.locked("uv", install.LOCKS["run"]) == expected


def test_uv_environment__pip_configured__is_handed_over(tree, monkeypatch):
    told = "global.index-url='https://index.example/simple'\n:env:.cert='/etc/ca.crt'\nglobal.find-links='/a /b'\n"
    monkeypatch.setattr(install, "run", lambda *_, **__: told)
    for name in ("UV_DEFAULT_INDEX", "SSL_CERT_FILE", "UV_FIND_LINKS"):
        monkeypatch.delenv(name, raising=False)
    env = install.uv_environment()
    assert env["UV_DEFAULT_INDEX"] == "https://index.example/simple"
    assert env["SSL_CERT_FILE"] == "/etc/ca.crt"
    assert env["UV_FIND_LINKS"] == "/a,/b"


def test_uv_environment__uv_configured__has_the_last_word(tree, monkeypatch):
    monkeypatch.setattr(install, "run", lambda *_, **__: "global.index-url='https://pip.example/simple'\n")
    monkeypatch.setenv("UV_DEFAULT_INDEX", "https://uv.example/simple")
    assert install.uv_environment()["UV_DEFAULT_INDEX"] == "https://uv.example/simple"


def test_check_compiler__none__is_told_in_one_sentence(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler -O2")
    with pytest.raises(SystemExit, match="no compiler 'no-such-compiler' is to be found: install gcc"):
        install.check_compiler()


def test_install__python_too_old__is_told_in_one_sentence():
    script = "import sys, runpy; sys.version_info = (3, 9, 2); runpy.run_path('tools/install.py', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("tactuator needs Python 3.11 or later; ")
    assert done.stderr.count("\n") == 1


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
