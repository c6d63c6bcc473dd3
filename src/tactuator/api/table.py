"""The verbs by name, in groups in the order of the chain, each with the function that it is.

A name of two words is a part of a verb. Functions are named as "module:function" below tactuator, and imported when
they are asked for: a room above the verbs may have one as well (`paper`, `web`, `console`).
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

Verb = Callable[..., Any]

VERBS: Mapping[str, Mapping[str, str]] = {
    "Files to start from": {"init": "api.start:init"},
    "The chain on a page": {"console": "console.serve:console"},
    "From a record to a model": {
        "calibrate": "api.model:calibrate",
        "record": "api.model:record",
        "identify": "api.model:identify",
    },
    "From a model to a controller on a board": {
        "design": "api.controller:design",
        "check": "api.controller:check",
        "wordlength": "api.controller:wordlength",
        "build": "api.controller:build",
        "image": "api.controller:image",
        "acknowledge": "api.board:acknowledge",
    },
    "What the display does": {
        "noise": "api.response:noise",
        "measure": "api.response:measure_response",
        "disturb": "api.response:disturb",
        "finger": "api.response:finger",
    },
    "Displays on sound cards": {
        "sound devices": "api.sound:devices",
        "sound latency": "api.sound:latency",
        "sound calibrate": "api.sound:calibrate_output",
        "calibrate-display": "api.sound:calibrate_display",
    },
    "What a person feels": {
        "curves": "api.start:curves",
        "experiment serve": "web.serve:serve",
        "experiment enrol": "api.experiment:enrol",
        "experiment correct": "api.experiment:correct",
        "experiment observe": "api.experiment:observe",
        "experiment thresholds": "api.experiment:thresholds",
        "experiment contours": "api.strength:contours",
        "experiment judged": "api.strength:judged",
        "experiment export": "api.experiment:export",
        "experiment waveforms": "api.items:waveforms",
        "experiment phonemes": "api.items:phonemes",
        "experiment recognise": "api.recognition:recognise",
        "experiment information": "api.recognition:information",
        "experiment backup": "api.experiment:backup",
        "experiment simulate": "api.experiment:simulate",
    },
    "Speech": {
        "render": "api.speech:render",
        "play": "api.speech:play",
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
