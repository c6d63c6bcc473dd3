"""The verbs by name, in groups in the order of the chain, each with the function that it is.

A name of two words is a part of a verb. Functions are named as "module:function" below tactuator, and imported when
they are asked for: a room above the verbs may have one as well (`paper`, `web`, `console`).
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

Verb = Callable[..., Any]

VERBS: Mapping[str, Mapping[str, str]] = {
    "Files to start from": {"init": "verbs.start:init"},
    "The chain on a page": {"console": "console.serve:console"},
    "From a record to a model": {
        "calibrate": "verbs.model:calibrate",
        "record": "verbs.model:record",
        "identify": "verbs.model:identify",
    },
    "From a model to a controller on a board": {
        "design": "verbs.controller:design",
        "check": "verbs.controller:check",
        "wordlength": "verbs.controller:wordlength",
        "build": "verbs.controller:build",
        "image": "verbs.controller:image",
        "acknowledge": "verbs.board:acknowledge",
    },
    "What the display does": {
        "noise": "verbs.response:noise",
        "measure": "verbs.response:measure_response",
        "disturb": "verbs.response:disturb",
        "finger": "verbs.response:finger",
    },
    "Displays on sound cards": {
        "sound devices": "verbs.sound:devices",
        "sound latency": "verbs.sound:latency",
        "sound calibrate": "verbs.sound:calibrate_output",
        "calibrate-display": "verbs.sound:calibrate_display",
    },
    "What a person feels": {
        "curves": "verbs.start:curves",
        "experiment serve": "web.serve:serve",
        "experiment enrol": "verbs.experiment:enrol",
        "experiment correct": "verbs.experiment:correct",
        "experiment observe": "verbs.experiment:observe",
        "experiment thresholds": "verbs.experiment:thresholds",
        "experiment contours": "verbs.strength:contours",
        "experiment judged": "verbs.strength:judged",
        "experiment export": "verbs.experiment:export",
        "experiment waveforms": "verbs.items:waveforms",
        "experiment phonemes": "verbs.items:phonemes",
        "experiment recognise": "verbs.recognition:recognise",
        "experiment information": "verbs.recognition:information",
        "experiment backup": "verbs.experiment:backup",
        "experiment simulate": "verbs.experiment:simulate",
    },
    "Speech": {
        "render": "verbs.speech:render",
        "play": "verbs.speech:play",
    },
    "The paper": {"reproduce": "paper.verb:reproduce"},
}
"""Functions of the verbs by name, in groups by title."""

PARTS: Mapping[str, str] = {
    "sound": "List sound cards, measure their delay and volts.",
    "experiment": "Run, simulate, analyse and export experiments.",
}
"""Verbs that have parts, with what they are for."""

FIRST = ("init", "calibrate", "identify", "design", "check", "measure", "experiment", "render")
"""Verbs of the first meeting."""

FUNCTIONS: dict[str, str] = {name: place for group in VERBS.values() for name, place in group.items()}
"""The place of every verb's function, by its name."""


def verb_of(name: str) -> Verb:
    """Return the function of a verb, or of a part of one; its module is imported."""
    module, _, function = FUNCTIONS[name].partition(":")
    verb: Verb = getattr(import_module(f"tactuator.{module}"), function)
    return verb


def top_verbs() -> tuple[str, ...]:
    """Return the verbs as the first word of a command, in the order of the chain."""
    return tuple(dict.fromkeys(name.partition(" ")[0] for name in FUNCTIONS))


def parts_of(verb: str) -> tuple[str, ...]:
    """Return the names of a verb's parts, none for a verb without parts."""
    return tuple(name.partition(" ")[2] for name in FUNCTIONS if name.startswith(f"{verb} "))
