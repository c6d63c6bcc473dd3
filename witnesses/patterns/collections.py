"""Reads every clip of a folder, and renders those that keep their format's rules on three displays.

The folder is that of a fetched collection (nothing of one is shipped), such as facebook/meta-haptics-sdk or
Lofelt/NiceVibrations. Not shared with the readers: the judge below, which knows the published rules of .haptic, AHAP
and ACF by itself. A file that one of them takes and the other refuses is a fault, and so is one that is taken and
does not render. Seen to fail with `--lax` (the judge lets frequencies outlast amplitudes). `--figures FOLDER` draws
ten of the clips on the three displays: asked, delivered, felt.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from tactuator.errors import BadInput
from tactuator.io.display import parse_display
from tactuator.io.shipped import display_template
from tactuator.model.controller import Controller
from tactuator.patterns.acf import read_acf
from tactuator.patterns.files import read_clip
from tactuator.patterns.rendering import MAPS, RenderedClip, render_clip
from tactuator.report.chart import draw
from tactuator.synthesis.design import design_controller
from tactuator.verbs.pattern import ClipResult

DISPLAYS = {"phone-like": "lra", "exciter-like": "exciter", "tactuator-like": "tactuator"}
ENDINGS = {".haptic", ".ahap", ".acf"}
TEN = 10


def rule_broken(path: Path, lax: bool) -> str:
    """Return the rule that a file breaks, "" for none."""
    text = path.read_text(encoding="utf-8-sig")
    try:
        if path.suffix == ".acf":
            return _acf(text)
        return _haptic(json.loads(text), lax) if path.suffix == ".haptic" else _ahap(json.loads(text))
    except (KeyError, TypeError, ValueError, IndexError) as error:
        return f"{type(error).__name__}: {error}"[:80]


def _haptic(document: Mapping[str, Any], lax: bool) -> str:
    envelopes = document["signals"]["continuous"]["envelopes"]
    loud, pitch = envelopes["amplitude"], envelopes.get("frequency") or []
    if document["version"]["major"] != 1:
        return "version"
    for points, key in ((loud, "amplitude"), (pitch, "frequency")):
        times = [point["time"] for point in points]
        if times != sorted(times) or any(at < 0 for at in times):
            return f"times of {key}"
        if any(not 0 <= point[key] <= 1 for point in points):
            return f"values of {key}"
    if len(loud) < 2 or loud[-1]["time"] <= loud[0]["time"]:
        return "duration"
    accents = [(point["emphasis"], point["amplitude"]) for point in loud if point.get("emphasis")]
    if any(not least <= accent["amplitude"] <= 1 or not 0 <= accent["frequency"] <= 1 for accent, least in accents):
        return "emphasis"
    if loud[-1]["time"] > 600:
        return "longer than is read (no rule of the format)"
    return "frequency outlasts amplitude" if pitch and pitch[-1]["time"] > loud[-1]["time"] and not lax else ""


def _ahap(document: Mapping[str, Any]) -> str:
    kinds = {"HapticTransient", "HapticContinuous", "AudioCustom", "AudioContinuous"}
    for entry in document["Pattern"]:
        if not {"Event", "Parameter", "ParameterCurve"} & set(entry):
            return f"entry {', '.join(entry)}"
        event = entry.get("Event")
        if event is not None and event["EventType"] not in kinds:
            return "event type"
        if event is not None and event["EventType"] == "HapticContinuous" and not event["EventDuration"] > 0:
            return "duration"
    return "" if any("Event" in entry for entry in document["Pattern"]) else "no event"


def _acf(text: str) -> str:
    values = dict(re.findall(r"^\s*(\w+):\s*([-\d.]+|'\w+')", re.sub(r"//.*", "", text), re.MULTILINE))
    return "" if {"gain", "emphasis_ducking", "output_frequency", "duration_ms", "shape"} <= set(values) else "keys"


def _taken(path: Path) -> str:
    """Return the sentence with which the readers refuse a file, "" where they take it."""
    try:
        (read_acf if path.suffix == ".acf" else read_clip)(path)
    except BadInput as error:
        return str(error).removeprefix(f"{path}: ")
    return ""


def _files(folders: Sequence[Path]) -> list[Path]:
    return sorted(path for folder in folders for path in folder.rglob("*") if path.suffix in ENDINGS)


def _rendered(path: Path, controllers: Mapping[str, Controller], longest_s: float) -> dict[str, RenderedClip]:
    """Return a clip on every display; of one that is too long for the purpose, none."""
    clip = read_clip(path, legacy=True)
    if clip.duration_s > longest_s:
        return {}
    return {name: render_clip(clip, each, MAPS[clip.format]) for name, each in controllers.items()}


def main() -> int:
    """Read, judge, render, count; return 0 where nothing was at fault."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--lax", action="store_true", help="a judge that is too kind: seen to fail")
    parser.add_argument("--longest-s", type=float, default=30.0, help="clips up to this are rendered")
    parser.add_argument("--figures", type=Path, help="folder for the figure of ten clips")
    asked = parser.parse_args()
    begun, counts, faults = time.monotonic(), Counter[str](), []
    kept: list[Path] = []
    for path in _files(asked.folders):
        broken, refused = rule_broken(path, asked.lax), _taken(path)
        counts[f"{path.suffix} {'refused' if refused else 'taken'}"] += 1
        if bool(broken) != bool(refused):
            faults.append(f"{path}: judge {broken or 'takes it'!r}, reader {refused or 'takes it'!r}")
        if refused:
            print(f"{path.name}: {refused}")
        if not refused or "--legacy" in refused:
            kept += [path] if path.suffix != ".acf" else []
    controllers = {
        name: design_controller(parse_display(tomllib.loads(display_template(kind)))) for name, kind in DISPLAYS.items()
    }
    clips = []
    for path in kept:
        try:
            each = _rendered(path, controllers, asked.longest_s)
        except BadInput as error:
            faults.append(f"{path}: does not render: {error}")
            continue
        counts["rendered" if each else f"longer than {asked.longest_s:g} s"] += 1
        clips += [each] if each else []
    if asked.figures is not None:
        _draw(clips[:: max(1, len(clips) // TEN)][:TEN], asked.figures)
    for words, count in sorted(counts.items()):
        print(f"{count:5} {words}")
    print(*faults, sep="\n")
    print(f"{len(faults)} faults in {time.monotonic() - begun:.0f} s")
    return 1 if faults else 0


def _draw(clips: Sequence[Mapping[str, RenderedClip]], folder: Path) -> None:
    """Draw clips as rows and displays as columns, and print the losses."""
    folder.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(15.0, 2.6 * len(clips)), layout="constrained")
    axes = figure.subplots(len(clips), len(DISPLAYS), squeeze=False)
    for row, clip in zip(axes, clips, strict=True):
        for panel, (name, rendered) in zip(row, clip.items(), strict=True):
            result = ClipResult(Path(rendered.clip.name), rendered, 3.0)
            draw(result.chart(), panel)
            loss = rendered.loss
            words = f"{rendered.clip.name}, {name}: short by {loss.shortfall_db_sl:.1f} dB SL"
            panel.locator_params(axis="x", nbins=5)
            panel.set_title(words, loc="left", fontsize=8, y=-0.42)
            print(f"{words}, on average {loss.mean_shortfall_db:.1f} dB; {loss.clipped_s:.2f} s clipped,"
                  f" pitch moved by {loss.frequency_shift_jnd:.1f} JND")  # fmt: skip
    figure.savefig(folder / "ten-clips.svg")
    figure.savefig(folder / "ten-clips.png", dpi=70)


if __name__ == "__main__":
    sys.exit(main())
