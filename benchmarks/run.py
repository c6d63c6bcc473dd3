"""Run the benchmarks: `python benchmarks/run.py [name ...]`, every `bench_<name>.py` when none is named.

Each benchmark is a module with `run() -> dict`: figures by name, a figure being a number, a text, a truth value or
a dictionary of figures. A benchmark compares with a peer in the same run, so that ratios mean something on any
machine. The figures go to standard output as a table and to `out/bench.json`.
"""

import json
import os
import platform
import sys
from collections.abc import Iterator, Mapping
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from rich.console import Console
from rich.table import Table

FOLDER = Path(__file__).resolve().parent
REPORT = FOLDER.parent / "out" / "bench.json"


def available() -> dict[str, Path]:
    return {path.stem.removeprefix("bench_"): path for path in sorted(FOLDER.glob("bench_*.py"))}


def figures_of(path: Path) -> dict[str, object]:
    """Run one benchmark in this process and return its figures."""
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path.name} cannot be imported")
    module = module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return dict(module.run())


def rows(figures: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield (dotted name, figure as text) for nested figures."""
    for name, value in figures.items():
        if isinstance(value, Mapping):
            yield from rows(value, f"{prefix}{name}.")
        else:
            yield prefix + str(name), f"{value:,.4g}" if isinstance(value, float) else f"{value}"


def machine() -> dict[str, object]:
    return {"machine": platform.machine(), "cores": os.cpu_count(), "python": platform.python_version()}


def main(names: list[str]) -> int:
    found = available()
    unknown = [name for name in names if name not in found]
    if unknown:
        print(f"no benchmark {unknown[0]!r}; there are {', '.join(found)}", file=sys.stderr)
        return 2
    results: dict[str, object] = {"machine": machine()}
    console = Console()
    for name in names or found:
        print(f"bench: {name} ...", file=sys.stderr, flush=True)
        figures = figures_of(found[name])
        results[name] = figures
        table = Table(title=name, title_justify="left", show_header=False)
        for row in rows(figures):
            table.add_row(*row)
        console.print(table)
    REPORT.parent.mkdir(parents=True, exist_ok=True)
    part = REPORT.with_suffix(".part")
    part.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    part.rename(REPORT)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
