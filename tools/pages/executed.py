"""Tutorials and gallery of the site, run when it is built: what a block printed stands beneath it, as do its figures.

A page is run again when its text, the package or the core changed; else what it said before is taken.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tools.pages.blocks import read_page
from tools.pages.run import PageFault, Said, make_folder, run_page

ROOT = Path(__file__).resolve().parents[2]
CACHE = ROOT / "out" / "site-cache" / "tutorials"
SHOWN = ("docs/tutorials/", "docs/gallery")
LONGEST = 60  # lines of an output; the rest is left out, and said


def sources_hash():
    """Return one hash of all that can change what a tutorial prints."""
    digest = hashlib.sha256()
    for place in ("src", "core", "tools/pages/run.py", "tools/pages/blocks.py"):
        for path in sorted((ROOT / place).rglob("*")) or [ROOT / place]:
            if path.is_file() and "__pycache__" not in path.parts and path.suffix not in (".so", ".o"):
                digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def kept_at(page, sources):
    """Return the folder of what a page said; its name is a hash of all that the page depends on."""
    text = (ROOT / f"{page}.md").read_text(encoding="utf-8")
    return CACHE / hashlib.sha256((text + sources).encode()).hexdigest()[:24]


def execute(page, kept):
    """Run a page in a process of its own: Sphinx imports the package in ways that a reader's program does not."""
    print(f"site: running {page}", flush=True)
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    command = [sys.executable, "-m", "tools.pages.executed", page, str(kept)]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if done.returncode != 0:
        raise PageFault(done.stdout)


def run_into(page, kept):
    """Run a page, and write what it said and its figures into a folder."""
    text = (ROOT / f"{page}.md").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "examples"
        make_folder(folder)
        said = run_page(text, page, folder)
        for figure in read_page(text)[1]:
            shutil.copy(folder / figure.path, kept / figure.path.replace("/", "-"))
    (kept / "said.json").write_text(json.dumps([vars(each) for each in said]))


def with_outputs(text, said, folder):
    """Return a page with the outputs and figures of its blocks after them."""
    _, figures, _ = read_page(text)
    added = {}
    for each in said:
        if each.output.strip():
            added.setdefault(each.end, []).append(_shown(each.output))
    for figure in figures:
        path = "/" + str((folder / figure.path.replace("/", "-")).relative_to(ROOT))
        added.setdefault(figure.line, []).append(
            f"```{{figure}} {path}\n:alt: {figure.caption}\n\n{figure.caption}\n```"
        )
    lines = text.splitlines()
    for line in sorted(added, reverse=True):
        lines[line:line] = ["", *"\n\n".join(added[line]).splitlines(), ""]
    return "\n".join(lines) + "\n"


def _shown(output):
    lines = [line.rstrip() for line in output.strip("\n").splitlines()]
    if len(lines) > LONGEST:
        lines = [*lines[:LONGEST], f"... ({len(lines) - LONGEST} lines more)"]
    return "\n".join(["````{code-block} text", ":class: output", "", *lines, "````"])


def _shows_outputs(app, page):
    return app.config.run_tutorials and page.startswith(SHOWN) and not page.endswith("README")


def _execute_pages(app, env, pages):
    """Run what is to be read and is not kept, as many pages at a time as there are cores."""
    runs = [(page, kept_at(page, app.tactuator_sources)) for page in pages if _shows_outputs(app, page)]
    with ThreadPoolExecutor(os.cpu_count()) as cores:
        list(cores.map(lambda run: execute(*run), [run for run in runs if not (run[1] / "said.json").exists()]))


def _add_outputs(app, page, source):
    if _shows_outputs(app, page):
        kept = kept_at(page, app.tactuator_sources)
        said = [Said(**each) for each in json.loads((kept / "said.json").read_text())]
        source[0] = with_outputs(source[0], said, kept)


def setup(app):
    """Run tutorials before they are read; `make site ARGS="-D run_tutorials=0"` leaves it out."""
    app.add_config_value("run_tutorials", True, "env", bool)
    app.tactuator_sources = sources_hash()
    app.connect("env-before-read-docs", _execute_pages)
    app.connect("source-read", _add_outputs, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    try:
        run_into(sys.argv[1], Path(sys.argv[2]))
    except PageFault as fault:
        sys.exit(str(fault))
