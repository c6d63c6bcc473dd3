"""What holds for every test."""

import gc
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from xdist.scheduler import LoadScopeScheduling

from tactuator.entry_points import plugins
from tactuator.model.controller import Controller
from tests.made_once import made_once
from tests.three_fingers import three_finger_display

pytest_plugins = ["tests.browser", "tests.program"]

# A test says nothing about wall-clock time, and the same tree gives the same outcome; the soak looks further.
settings.register_profile("test", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("soak", deadline=None, max_examples=20_000, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "test"))

gc.disable()  # until all is imported and collected, of which nothing is garbage: a fifth of that time

# A shell starts what runs in the background with SIGINT ignored; the programs under test would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def designs_and_models(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Each channel is designed, and each record identified, once for all tests that ask for the same."""
    import tactuator.api.controller as controllers
    import tactuator.identification.identify as identification
    from tactuator.synthesis import design, strength

    base = tmp_path_factory.getbasetemp()  # of this run; a worker's is in the folder of all workers
    kept = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "made-once"
    kept.mkdir(exist_ok=True)
    functions = design.design_channel, identification.identify, strength._shaping, controllers.controller_bits
    once = {id(function): made_once(kept, function) for function in functions}
    with pytest.MonkeyPatch.context() as patch:
        for module in [module for name, module in sys.modules.items() if name.startswith("tactuator.")]:
            for name, value in list(vars(module).items()):
                if id(value) in once:  # under whatever name it was imported
                    patch.setattr(module, name, once[id(value)])
        yield


@pytest.fixture(scope="session")
def controller() -> Controller:
    """A controller designed for a display with three fingers, once for all tests that play references."""
    from tactuator.io.display import parse_display
    from tactuator.synthesis.design import design_controller

    return design_controller(parse_display(three_finger_display()))


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """A function that puts a package with one entry point on the path, as an installed one of another laboratory is."""
    modules: list[str] = []

    def put(group: str, name: str, source: str, attribute: str, package: str = "foreign_laboratory") -> None:
        (tmp_path / f"{package}.py").write_text(source)
        info = tmp_path / f"{package}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {package}:{attribute}\n")
        monkeypatch.syspath_prepend(tmp_path)
        modules.append(package)
        plugins.cache_clear()

    yield put
    plugins.cache_clear()
    for module in modules:
        sys.modules.pop(module, None)


#: What is made once for several files, or for a part of one: those tests go to one worker.
_SHARED = {
    "tests/fuzz/": "the sanitised core",
    "tests/paper/test_": "the study",
}


@cache
def _makes_once(file: Path) -> bool:
    """Whether a file of tests makes something for all of them, or keeps it for the next."""
    return re.search(r'scope="module"|^@(lru_)?cache$', file.read_text(encoding="utf-8"), re.MULTILINE) is not None


class _MadeOnce(LoadScopeScheduling):  # type: ignore[misc]
    """Every test goes to the worker that is free, but those that share what is made once go to one worker."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        alone = file if _makes_once(self.config.rootpath / file) else nodeid
        return next((shared for start, shared in _SHARED.items() if nodeid.startswith(start)), alone)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    return _MadeOnce(config, log)


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """In a fresh tree the first worker rewrites the assertions of all tests, which takes as long as all else that a
    worker does before its first test; the others wait until the last file is written, or for two minutes."""
    config, last = session.config, max(Path(__file__).parent.rglob("test_*.py"))
    kept = f"__pycache__/{last.stem}.{sys.implementation.cache_tag}-pytest-{pytest.__version__}.pyc"
    second = getattr(config, "workerinput", {"workerid": "gw0"})["workerid"] != "gw0" and not sys.dont_write_bytecode
    end = time.monotonic() + (120.0 if second and config.args_source is config.ArgsSource.TESTPATHS else 0.0)
    while not (last.parent / kept).exists() and time.monotonic() < end:
        time.sleep(0.2)


_BROWSER = ("chromium",)
_DEVICE = ("rig/", "firmware/", "fuzz/")
_INTEGRATION = (
    "cli/",
    "paper/",
    "web/",
    "repository/",
    "experiment/session/",
    "speech/test_render",
    "speech/test_folder",
    "pages/",
    "test_processors",
)

#: Whose tests `make quick` runs, where they import nothing from above: of every lower room what needs least time.
_QUICK = (
    "identification/test_recursive", "identification/test_distortion", "io/test_load", "io/test_record", "io/test_st",
    "measure/", "model/test_description", "perception/", "runtime/", "signals/test_excitation", "speech/test_re",
    "synthesis/test_monte_carlo", "wordlength/test_bits", "test_",
)  # fmt: skip
_ABOVE = re.compile(r"tactuator\.(cli|console|web|paper|api|report|experiment|rig)\b|^import tactuator", re.MULTILINE)


def _kind(file: Path) -> str:
    """The kind of a file's tests, by its place below tests/; "quick" is a unit test that may be."""
    place = file.relative_to(Path(__file__).parent).as_posix()
    if any(part in place for part in _BROWSER):
        return "browser"
    if place.startswith(_DEVICE):
        return "device"
    if place.startswith(_INTEGRATION):
        return "integration"
    quick = place.startswith(_QUICK) and not _ABOVE.search(file.read_text(encoding="utf-8"))
    return "quick" if quick else "unit"


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """`-m quick` imports no file that has no quick test, nor what its folder needs: that took longer than the tests."""
    if config.getoption("markexpr") != "quick":
        return None
    files = collection_path.rglob("test_*.py") if collection_path.is_dir() else [collection_path]
    return None if any(_kind(file) == "quick" for file in files) else True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test by its place in the tree: browser, device, integration or unit; the slow ones begin first."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)  # or one of them ends alone
    kinds = {path: _kind(path) for path in {item.path for item in items}}
    for item in items:
        kind = kinds[item.path]
        item.add_marker("unit" if kind == "quick" else kind)
        if kind == "quick" and not any(item.iter_markers("slow")) and not any(item.iter_markers("soak")):
            item.add_marker("quick")


def pytest_collection_finish(session: pytest.Session) -> None:
    """Keep the garbage collector from walking through thousands of tests again and again: they stay until the end."""
    gc.freeze()
    gc.enable()
