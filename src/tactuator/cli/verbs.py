"""The verbs of the command line in groups, in the order of the chain, and what each group is called.

A group is a folder below tactuator.cli whose module `verbs` has the signatures.
"""

GROUPS: dict[str, tuple[str, ...]] = {
    "start": ("init",),
    "console": ("console",),
    "model": ("calibrate", "record", "identify"),
    "controller": ("design", "check", "wordlength", "build", "image", "firmware"),
    "response": ("noise", "measure", "disturb", "finger"),
    "sound": ("sound", "calibrate-display"),
    "experiment": ("experiment",),
    "speech": ("waveforms", "render", "play", "corpus"),
    "paper": ("reproduce",),
}

TITLES: dict[str, str] = {
    "start": "Files to start from",
    "console": "The chain on a page",
    "model": "From a record to a model",
    "controller": "From a model to a controller on a board",
    "response": "What the display does",
    "sound": "Displays on sound cards",
    "experiment": "What a person feels",
    "speech": "Speech",
    "paper": "The paper",
}

PARTS: dict[str, str] = {
    "firmware": "Programs for boards: build them, compare their bits, count their instructions.",
    "sound": "Sound cards: list them, measure their delay and their volts, try one that is simulated.",
    "experiment": "Detection and recognition: run, simulate, analyse, export.",
}
"""Verbs that have parts, with what they are for."""

ROOMS: dict[str, str] = {verb: group for group, verbs in GROUPS.items() for verb in verbs}
"""The group of each verb."""

VERBS: tuple[str, ...] = tuple(ROOMS)
