"""What is packed can be built and used elsewhere."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BUILD = "import sys; from setuptools import build_meta as b; print(getattr(b, sys.argv[1])(sys.argv[2]))"


def packed(kind: str, source: Path, target: Path) -> Path:
    done = subprocess.run(
        [sys.executable, "-c", BUILD, f"build_{kind}", str(target)],
        cwd=source, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return target / done.stdout.splitlines()[-1]


@pytest.mark.slow
def test_source_distribution__built_elsewhere__gives_a_wheel_with_core_and_data(tmp_path):
    tree, unpacked = tmp_path / "tree", tmp_path / "unpacked"
    unwanted = shutil.ignore_patterns("*.so", "*.egg-info", "__pycache__")
    for name in ("src", "core"):
        shutil.copytree(ROOT / name, tree / name, ignore=unwanted)
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy(path, tree)
    with tarfile.open(packed("sdist", tree, tmp_path)) as archive:
        archive.extractall(tmp_path / "sdist", filter="data")
    (source,) = (tmp_path / "sdist").iterdir()
    with zipfile.ZipFile(packed("wheel", source, tmp_path)) as archive:
        archive.extractall(unpacked)
    script = (
        "import tactuator.runtime._core as core; from tactuator.perception.library import curve; print(core.__file__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script + "; curve('bolanowski-1988')"],
        cwd=tmp_path, env=dict(os.environ, PYTHONPATH=str(unpacked)), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()).is_relative_to(unpacked)
