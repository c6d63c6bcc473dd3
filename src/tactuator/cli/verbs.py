"""The verbs of the command line in groups, in the order of the chain, and the module of each."""

GROUPS: dict[str, dict[str, str]] = {
    # group of `tactuator --help`: verb -> module below tactuator.cli, which has `register(app)`
    "start": {"init": "init"},
    "model": {"calibrate": "model.calibrate", "record": "model.record", "identify": "model.identify"},
    "controller": {
        "design": "controller.design",
        "check": "controller.check",
        "wordlength": "controller.wordlength",
        "build": "controller.build",
        "image": "controller.image",
        "firmware": "controller.firmware",
    },
    "response": {"noise": "response.noise", "measure": "response.measure", "disturb": "response.disturb"},
    "person": {"experiment": "experiment"},
    "speech": {
        "waveforms": "speech.waveforms",
        "render": "speech.render",
        "play": "speech.play",
        "corpus": "speech.corpus",
    },
    "paper": {"reproduce": "reproduce"},
}

MODULES: dict[str, str] = {verb: module for group in GROUPS.values() for verb, module in group.items()}

VERBS: tuple[str, ...] = tuple(MODULES)
