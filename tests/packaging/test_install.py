"""tools/install.py for real, in trees of their own with packages of a few lines: what goes wrong is one line.

Nothing half-made is left, so the next run starts clean.
"""

import ast
import os
import pty
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.packaging.wheels import lock_line, wheel

ROOT = Path(__file__).resolve().parents[2]
PROJECT = '[build-system]\nrequires = []\nbuild-backend = "wheels"\nbackend-path = ["."]\n'

#: Stands in for Python's module, which makes one `.venv` as it was asked to; each is a copy, and pip installed once.
VENV = """
import os, shutil, subprocess, sys
*asked, folder = sys.argv[1:]
if not os.path.exists({0!r}):
    subprocess.run([sys.executable, "-I", "-m", "venv", *asked, {0!r}], check=True)
shutil.copytree({0!r}, folder, symlinks=True)
"""

pytestmark = pytest.mark.slow


class Tree:
    """The set-up's own files, one runtime package `alpha`, one more, `beta`, in the test set."""

    def __init__(self, folder: Path, empty: Path) -> None:
        self.root, self.index, self.modules = folder / "tree", folder / "index", folder / "modules"
        self.modules.mkdir()
        self.index.mkdir()
        (self.root / "tools").mkdir(parents=True)
        shutil.copy(ROOT / "tools/install.py", self.root / "tools")
        shutil.copy(ROOT / "tests/packaging/wheels.py", self.root)
        for name in ("requirements", "core", "src/tactuator/room"):
            (self.root / name).mkdir(parents=True)
        (self.root / "pyproject.toml").write_text(PROJECT)
        for name in ("setup.py", "core/a.c", "src/tactuator/room/_core_build.py", "src/tactuator/room/_core.py"):
            (self.root / name).touch()
        (self.root / "requirements/run.in").write_text("alpha\n")
        (self.modules / "venv.py").write_text(VENV.format(str(empty)))
        self.beta = wheel(self.index, "beta", "1", {"beta.py": ""})
        self.write_locks(lock_line(wheel(self.index, "alpha", "1", {"alpha.py": ""})))

    def write_locks(self, line: str) -> None:
        (self.root / "requirements/run.txt").write_text(line)
        (self.root / "requirements/test.txt").write_text(line + lock_line(self.beta))

    @property
    def venv(self) -> Path:
        return self.root / ".venv"

    def environment(self, **more: str) -> dict[str, str]:
        """No index but the folder, and nothing of what this machine tells pip."""
        here = {name: value for name, value in os.environ.items() if not name.startswith(("PIP_", "PYTHON"))}
        here |= {"PIP_CONFIG_FILE": os.devnull, "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(self.index)}
        return here | {"PIP_RETRIES": "1", "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(self.modules)} | more

    def command(self, which: str = "run") -> list[str]:
        return [os.path.realpath(sys._base_executable), str(self.root / "tools/install.py"), which]

    def install(self, which: str = "run", **more: str) -> subprocess.CompletedProcess[str]:
        how = {"env": self.environment(**more), "capture_output": True, "text": True}
        return subprocess.run(self.command(which), **how, check=False)

    def runs(self, script: str) -> bool:
        return not subprocess.run([self.venv / "bin/python", "-c", script], capture_output=True, check=False).returncode


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a `.venv` with pip alone is kept."""
    return tmp_path_factory.mktemp("empty") / ".venv"


@pytest.fixture
def tree(tmp_path: Path, empty: Path) -> Tree:
    return Tree(tmp_path, empty)


def refusal(done: subprocess.CompletedProcess[str]) -> str:
    """The one line that says why; the others tell what was being done."""
    assert done.returncode == 1, done.stderr
    (line,) = [line for line in done.stderr.splitlines() if not line.startswith("install: ")]
    return line


def closed_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_install__two_at_once_then_a_new_core_and_lock__does_what_is_due(tree):
    how = {"env": tree.environment(), "stderr": subprocess.PIPE, "text": True}
    both = [subprocess.Popen(tree.command(), **how) for _ in range(2)]
    said = [process.communicate()[1] for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert sorted(text.count("making .venv") for text in said) == [0, 1]
    assert list(tree.venv.glob("lib/python3*/site-packages/__pycache__/alpha.*.pyc"))
    assert tree.runs("import alpha, tactuator.room._core")
    assert not tree.runs("import beta")
    mark = tree.venv / "mark"
    mark.touch()

    assert tree.install("test").returncode == 0  # added to what is there
    assert tree.runs("import alpha, beta, tactuator.room._core")
    assert mark.exists()
    again = tree.install("run")
    assert (again.returncode, again.stderr) == (0, "")
    (tree.root / "core/b.h").write_text("int changed;\n")
    assert tree.install().stderr == "install: building the C core\n"

    tree.write_locks(lock_line(wheel(tree.index, "alpha", "2", {"alpha2.py": ""})))
    (tree.root / "requirements/run.in").write_text("alpha2\n")
    assert tree.install().returncode == 0  # all of it anew, the larger set
    assert tree.runs("import alpha2, beta, tactuator.room._core")
    assert not tree.runs("import alpha")
    assert not mark.exists()


def test_install__at_a_terminal__says_last_what_to_type_next(tree):
    here, there = pty.openpty()
    subprocess.run(tree.command(), env=tree.environment(), stderr=there, check=True)
    assert os.read(here, 1 << 16).endswith(b"next: `. .venv/bin/activate`, then `tactuator`\r\n")
    os.close(here)
    os.close(there)


def test_install__killed_then_without_an_index__starts_clean_and_keeps_what_is(tree):
    how = {"env": tree.environment(), "start_new_session": True, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(tree.command(), **how)
    while not any(tree.venv.glob("lib/python3*/site-packages/alpha.py")):
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)  # as a power cut would
    process.wait()
    (tree.venv / "half-made").touch()
    assert tree.install().returncode == 0
    assert not (tree.venv / "half-made").exists()
    away = {"PIP_NO_INDEX": "0", "PIP_FIND_LINKS": "", "PIP_INDEX_URL": f"http://127.0.0.1:{closed_port()}/simple"}
    line = refusal(tree.install("test", **away))
    assert "requirements/test.txt could not be installed: the package index cannot be reached (NewConnection" in line
    assert tree.install("run", **away).stderr == ""
    assert tree.runs("import alpha, tactuator.room._core")


def test_install__other_file_or_none__is_one_line_and_nothing_stays(tree):
    broken = "raise OSError(\"cannot load library 'libstray.so': cannot open shared object file\")\n"
    lines = {
        "a file for alpha==1 is not the one whose hash the lock holds": f"alpha==1 --hash=sha256:{64 * '0'}\n",
        "offers no file of gamma==1 for Python 3.": f"gamma==1 --hash=sha256:{64 * '0'}\n",
        "alpha is installed and cannot be imported; remedy: `make clean`, then the same again: OSError: cannot load "
        "library 'libstray.so'": lock_line(wheel(tree.index, "alpha", "1", {"alpha.py": broken})),
    }
    for words, line in lines.items():
        tree.write_locks(line)
        assert words in refusal(tree.install())
        assert not tree.venv.exists()


def run_as(lines: str, folder: Path) -> tuple[int, str]:
    """What becomes of the set-up after these lines of Python, in the folder of a tree."""
    script = f"import os, runpy, sys; {lines}; runpy.run_path('tools/install.py', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


def test_install__python_too_old__is_told_in_one_sentence_that_it_can_parse():
    status, said = run_as("sys.version_info = (3, 9, 2)", ROOT)
    assert (status, said.count("\n")) == (1, 1)
    assert said.startswith("tactuator needs Python 3.11 or later; ")
    ast.parse((ROOT / "tools/install.py").read_text(encoding="ascii"), feature_version=(3, 4))


def test_install__compiler_room_or_system_package_lacking__is_named_in_one_line(tree):
    for compiler, words in (
        ("no-such-compiler -O2", "a C compiler ('no-such-compiler'; CC names another); missing on Debian: gcc"),
        ("false", "the C compiler 'false' cannot build a program (apt-get install gcc libc6-dev): nothing was said"),
    ):
        assert words in refusal(tree.install(CC=compiler))
    small = (
        "from types import SimpleNamespace as disk; import shutil; shutil.disk_usage = lambda path: disk(free=4e7); "
    )
    assert "no room for .venv: it needs about 450 MB" in run_as(f"{small}sys.argv[1:] = ['run']", tree.root)[1]
    (tree.root / "requirements/system.txt").write_text("# head\nno-such-command the-package boards\n")
    how = run_as("os.geteuid = lambda: 1; sys.argv = ['install.py', 'boards']", tree.root)
    assert how == (1, "needed from the system: apt-get install the-package\n")
