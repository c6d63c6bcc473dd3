"""Draw `docs/figures/floors.svg` from the import contract in pyproject.toml: `make docs`. A test holds it current."""

import re
import tomllib
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs" / "figures" / "floors.svg"
TASKS = {
    "cli": "asks, calls one verb, prints its result",
    "console": "a page on which a loop is shaped by dragging",
    "paper": "the paper's run; pages in a browser",
    "api": "one function for each verb; one result for every face",
    "report": "figures and pages from results",
    "speech": "coding and limiting; protocol, session, store, result",
    "measure": "responses, noise, disturbance, felt levels",
    "rig": "runs an image and can be touched",
    "synthesis": "loop, prefilter, verdict",
    "wordlength": "word length",
    "identification": "a model with its uncertainty, from a record",
    "runtime": "the core's binding: image, safety, simulation",
    "io": "read and write; the nouns; L, S, T and margins",
    "perception": "curves and levels; systems, stimuli, spectra",
    "parameters": "one field for each parameter",
    "arrays": "types of arrays; the tree of errors; helper processes",
}
LEFT, WIDE, ROW, GAP, BOX = 84, 400, 46, 8, 34
WIDTH = 860
UPRIGHT = ' transform="rotate(-90)"'
STYLE = "font-family:DejaVu Sans,Helvetica,Arial,sans-serif;font-size:13px"


def floors():
    """Return the rooms of every floor, from the highest down, as the contract lists them."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (layers,) = [each["layers"] for each in settings["tool"]["importlinter"]["contracts"] if each["type"] == "layers"]
    return [re.findall(r"\w+", layer) for layer in layers]


def picture():
    """Return the picture as SVG text."""
    rows = floors()
    bottom = 20 + ROW * len(rows)
    parts = []
    for level, rooms in enumerate(rows):
        top = 20 + ROW * level
        wide = (WIDE - GAP * (len(rooms) - 1)) / len(rooms)
        for place, room in enumerate(rooms):
            parts.append(box(LEFT + place * (wide + GAP), top, wide, room))
        parts.append(text(LEFT + WIDE + 16, top + BOX / 2 + 5, TASKS[rooms[0]], "fill:#444444"))
    core, middle = bottom + 20, level_of(rows, "runtime")
    parts += [
        box(LEFT, core, WIDE, "core/   C99: control, board, link, display"),
        text(LEFT + WIDE + 16, core + BOX / 2 + 5, "the same sources in the package and on boards", "fill:#444444"),
        box(LEFT, core + ROW, WIDE, "firmware/   main.c, one folder a board"),
        text(LEFT + WIDE + 16, core + ROW + BOX / 2 + 5, "converters, timer, UART of a board", "fill:#444444"),
        arrow(f"M {LEFT} {middle} H {LEFT - 22} V {core + BOX / 2 - 6} H {LEFT - 2}"),
        arrow(f"M {LEFT} {core + ROW + BOX / 2} H {LEFT - 22} V {core + BOX / 2 + 6} H {LEFT - 2}"),
        arrow(f"M 24 24 V {bottom - 16}"),
        text(
            -(bottom + 4) / 2, 16, "an import goes down", "fill:#444444;text-anchor:middle", ' transform="rotate(-90)"'
        ),
    ]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {core + 2 * ROW + 4}" style="{STYLE}">'
    tip = (
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M 0 0 L 8 4 L 0 8 z" fill="#0072b2"/></marker></defs>'
    )
    ground = f'<rect width="{WIDTH}" height="{core + 2 * ROW + 4}" fill="#ffffff"/>'
    return "\n".join([head, tip, ground, *parts, "</svg>\n"])


def level_of(rows, room):
    """Return the height (in the picture) of the middle of the floor that holds `room`."""
    (level,) = [at for at, rooms in enumerate(rows) if room in rooms]
    return 20 + ROW * level + BOX / 2


def box(left, top, wide, words):
    """Return a box with a name in its middle."""
    frame = f'<rect x="{left:g}" y="{top:g}" width="{wide:g}" height="{BOX}" rx="4" fill="#eef4f9" stroke="#0072b2"/>'
    return frame + "\n" + text(left + wide / 2, top + BOX / 2 + 5, words, "text-anchor:middle")


def text(left, top, words, style, more=""):
    """Return a line of text."""
    return f'<text x="{left:g}" y="{top:g}" style="{style}"{more}>{escape(words)}</text>'


def arrow(path):
    """Return a line along `path` with a tip at its end."""
    return f'<path d="{path}" fill="none" stroke="#0072b2" marker-end="url(#tip)"/>'


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
