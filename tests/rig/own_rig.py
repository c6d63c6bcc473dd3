"""The example of docs/rig.md, installed as the package of another laboratory."""

import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from tactuator.entry_points import plugins

PAGE = Path(__file__).resolve().parents[2] / "docs" / "rig.md"


def example() -> tuple[str, str]:
    """The page's module and its pyproject.toml."""
    text = PAGE.read_text(encoding="utf-8")
    code, project = (text.split(f"```{language}\n")[1].split("```")[0] for language in ("python", "toml"))
    return code, project


@contextmanager
def installed_example() -> Iterator[str]:
    """The example among the installed packages, as long as the context lasts; the name of its rig."""
    code, text = example()
    project = tomllib.loads(text)
    (module,) = project["tool"]["setuptools"]["py-modules"]
    ((group, points),) = project["project"]["entry-points"].items()
    ((name, value),) = points.items()
    with TemporaryDirectory() as folder:
        info = Path(folder) / f"{module}-{project['project']['version']}.dist-info"
        info.mkdir()
        (Path(folder) / f"{module}.py").write_text(code, encoding="utf-8")
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['project']['name']}\nVersion: 0.1\n")
        (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {value}\n")
        sys.path.insert(0, folder)
        plugins.cache_clear()
        try:
            yield name
        finally:
            sys.path.remove(folder)
            sys.modules.pop(module, None)
            plugins.cache_clear()
