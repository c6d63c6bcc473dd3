"""The site's tutorials, run when it is built: what a block printed stands beneath it, and its figures are shown.

A tutorial is run again when its text, the package or the core changed; else what it said before is taken.
"""

import hashlib
import json
import shutil
import tempfile
from pathlib import Path

from tools.pages.blocks import read_page
from tools.pages.run import Said, make_folder, run_page

ROOT = Path(__file__).resolve().parents[2]
CACHE = ROOT / "out" / "site-cache" / "tutorials"
TUTORIALS = "docs/tutorials/"
LONGEST = 60  # lines of an output; the rest is left out, and said


def sources_hash():
    """Return one hash of all that can change what a tutorial prints."""
    digest = hashlib.sha256()
    for folder in ("src", "core", "tools/pages"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts and path.suffix not in (".so", ".o"):
                digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def executed(page, text, sources):
    """Return what the blocks of a page said, and the folder of its figures; run it where it is not kept."""
    kept = CACHE / hashlib.sha256((text + sources).encode()).hexdigest()[:24]
    if not (kept / "said.json").exists():
        shutil.rmtree(kept, ignore_errors=True)
        kept.mkdir(parents=True)
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "examples"
            make_folder(folder)
            said = run_page(text, page, folder)
            for figure in read_page(text)[1]:
                shutil.copy(folder / figure.path, kept / figure.path.replace("/", "-"))
        (kept / "said.json").write_text(json.dumps([vars(each) for each in said]))
    return [Said(**each) for each in json.loads((kept / "said.json").read_text())], kept


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


def _run_tutorial(app, page, source):
    if app.config.run_tutorials and page.startswith(TUTORIALS) and not page.endswith("README"):
        print(f"site: {page}", flush=True)
        said, folder = executed(page, source[0], app.tactuator_sources)
        source[0] = with_outputs(source[0], said, folder)


def setup(app):
    """Run tutorials as they are read; `make site ARGS="-D run_tutorials=0"` leaves it out."""
    app.add_config_value("run_tutorials", True, "env", bool)
    app.tactuator_sources = sources_hash()
    app.connect("source-read", _run_tutorial, priority=100)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
