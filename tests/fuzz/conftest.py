"""Programs of C under libFuzzer, address and undefined-behaviour sanitisers; the core is compiled for them once."""

import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "core"
SANITISED = ("-O1", "-fsanitize=fuzzer,address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")


def compiled(folder: Path, *words: object, flags: Iterable[str] = SANITISED) -> None:
    """Run the compiler in the folder, where it finds headers as in the core."""
    clang = shutil.which("clang")
    assert clang, "clang is missing: make test installs it"
    common = ["-std=c99", "-gline-tables-only", "-ffp-contract=off", "-I", CORE, "-I", folder, *flags]
    subprocess.run([clang, *common, *words], cwd=folder, check=True)


def sources() -> list[Path]:
    """The core as boards have it, and the simulated display."""
    return sorted(path for path in CORE.rglob("*.c") if path.relative_to(CORE).parts[0] != "host")


@pytest.fixture(scope="session")
def objects(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("core")
    compiled(folder, "-c", *sources())
    return sorted(folder.glob("*.o"))


def fuzz(folder: Path, name: str, objects: list[Path], seeds: dict[str, bytes], longest: int, until: str) -> str:
    """Fuzz NAME.c from these inputs until then; `corpus` in the folder holds what came of them. Return what it says."""
    program, corpus = folder / f"fuzz-{name}", folder / "corpus"
    compiled(folder, ROOT / f"tests/fuzz/{name}.c", *objects, "-lm", "-o", program)
    corpus.mkdir(exist_ok=True)
    for key, content in seeds.items():
        (corpus / key).write_bytes(content)
    limits = [until, f"-max_len={longest}", "-seed=1", "-rss_limit_mb=4096", "-print_final_stats=1"]
    done = subprocess.run([program, corpus, *limits], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stderr
