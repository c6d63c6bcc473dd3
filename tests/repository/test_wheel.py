"""The wheel: built as `make wheel` does, installed where there is neither compiler nor checkout, and run there."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactuator.rig.program import BOARDS, build_firmware
from tools import wheel as maker

ROOT = Path(__file__).resolve().parents[2]


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
        assert build_firmware(name, emulated, ("-Werror",)).exists()


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The bin folder of an environment that holds the wheel and the runtime set, and nothing else."""
    place = tmp_path_factory.mktemp("wheel")
    maker.main()
    (wheel,) = maker.DIST.glob("*-cp311-abi3-*.whl")
    subprocess.run([sys.executable, "-m", "venv", place / "env"], check=True)
    pip = [place / "env" / "bin" / "python", "-m", "pip", "install", "--quiet"]
    lock = ROOT / "requirements" / "run.txt"
    subprocess.run([*pip, "--require-hashes", "--only-binary=:all:", "-r", lock], check=True)
    subprocess.run([*pip, "--no-deps", "--no-index", wheel], check=True)
    yield place / "env" / "bin"
    shutil.rmtree(place, ignore_errors=True)


def run(installed: Path, folder: Path, *words: str, path: str = "") -> subprocess.CompletedProcess[str]:
    environment = {"PATH": f"{installed}:{path}", "HOME": str(folder), "OPENBLAS_NUM_THREADS": "1"}
    command = [installed / "tactuator", *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.slow
def test_wheel__where_there_is_no_compiler__designs_and_reproduces(installed: Path, tmp_path: Path) -> None:
    told = "import shutil, tactuator; print(tactuator.__file__, shutil.which('gcc'), shutil.which('cc'))"
    asked = [installed / "python", "-c", told]
    said = subprocess.run(asked, env={"PATH": str(installed)}, cwd=tmp_path, capture_output=True, text=True, check=True)
    file, *compilers = said.stdout.split()
    assert Path(file).is_relative_to(installed.parent)
    assert compilers == ["None", "None"]
    run(installed, tmp_path, "init", "--examples", ".")
    run(installed, tmp_path, "design", "display.toml", "--out", "controller.json")
    run(installed, tmp_path, "reproduce", "--out", "paper")
    assert (tmp_path / "paper" / "report.html").stat().st_size > 100_000


@pytest.mark.slow
def test_wheel__serves_an_experiment(installed: Path, tmp_path: Path) -> None:
    run(installed, tmp_path, "init", "--examples", ".")
    command = [installed / "tactuator", "experiment", "serve", "protocol.toml", "--store", "lab.db", "--port", "0"]
    environment = {"PATH": str(installed), "HOME": str(tmp_path)}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True) as server:
        try:
            assert server.stderr is not None
            assert re.search(r"http://127\.0\.0\.1:\d+/", server.stderr.readline())
        finally:
            server.terminate()
    assert (tmp_path / "lab.db").exists()


@pytest.mark.slow
def test_wheel__with_the_cross_compiler__builds_the_firmware_from_its_own_sources(
    installed: Path, tmp_path: Path
) -> None:
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in ("gcc", "objcopy", "size"):
        (tools / f"arm-none-eabi-{name}").symlink_to(shutil.which(f"arm-none-eabi-{name}") or "")
    out = run(installed, tmp_path, "firmware", "program", "--board", "stm32f405", "--out", "f.bin", "--json",
              path=str(tools))  # fmt: skip
    assert json.loads(out.stdout)["flash_bytes"] > 10_000
