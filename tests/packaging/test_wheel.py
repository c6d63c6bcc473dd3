"""The wheel: built as `make wheel` does, installed where there is neither compiler nor checkout, and run there."""

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tactuator.rig.boards import BOARDS, build_firmware
from tests.packaging.conftest import ROOT, Installation
from tools import wheel as maker


def test_require_tag__that_promises_an_older_system_than_is_needed__is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(maker, "policy", lambda path: "manylinux_2_34_x86_64")
    maker.require_tag(tmp_path, "manylinux_2_34_x86_64")
    with pytest.raises(SystemExit, match="keep to manylinux_2_34_x86_64, and its name says manylinux_2_17_x86_64"):
        maker.require_tag(tmp_path, "manylinux_2_17_x86_64")


def test_policy__of_what_is_no_wheel__stops(monkeypatch):
    monkeypatch.setattr(maker, "auditor", lambda: "echo")
    with pytest.raises(SystemExit, match="names no platform"):
        maker.policy("none.whl")


@pytest.mark.slow
@pytest.mark.parametrize("emulated", [True, False])
def test_firmware__of_every_board__compiles_without_a_warning(emulated):
    for name in [name for name, board in BOARDS.items() if emulated or board.is_real]:
        assert build_firmware(name, emulated).with_suffix(".txt").read_text() == ""


@pytest.mark.slow
def test_wheel__installed__has_the_pages_as_they_are_and_neither_compiler_nor_checkout(
    installation: Installation,
) -> None:
    told = "import hashlib, pathlib, shutil, tactuator; root = pathlib.Path(tactuator.__file__).parent\n"
    told += "print(root, shutil.which('gcc'), shutil.which('cc'))\n"
    told += "for p in root.glob('*/static/*'): print(hashlib.sha256(p.read_bytes()).hexdigest(), p.relative_to(root))"
    said = subprocess.run(
        [installation.prefix / "bin" / "python", "-c", told],
        env=installation.environment(), cwd=installation.folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    (folder, *compilers), *parts = map(str.split, said.stdout.splitlines())
    assert Path(folder).is_relative_to(installation.prefix)
    assert compilers == ["None", "None"]
    package = ROOT / "src" / "tactuator"
    here = {str(p.relative_to(package)): hashlib.sha256(p.read_bytes()).hexdigest() for p in package.glob("*/static/*")}
    assert {name: digest for digest, name in parts} == here
    assert len([name for name in here if name.startswith("console/static/")]) > 20


@pytest.mark.slow
def test_wheel__from_an_empty_folder__gives_a_controller_that_meets_its_objectives(lab: Installation) -> None:
    assert json.loads(lab.run("check", "controller.json", "--json").stdout)["outcome"] == "met"


@pytest.mark.slow
def test_wheel__with_the_cross_compiler__builds_the_firmware_from_its_own_sources(
    installation: Installation, tmp_path: Path
) -> None:
    for name in ("gcc", "objcopy", "size"):
        (tmp_path / f"arm-none-eabi-{name}").symlink_to(shutil.which(f"arm-none-eabi-{name}") or "")
    out = installation.run("firmware", "program", "--board", "stm32f405", "--out", "f.bin", "--json", path=tmp_path)
    assert json.loads(out.stdout)["flash_bytes"] > 10_000
