"""The verbs of the command line, in the order of the chain: each is a module `tactuator.cli.<verb>`."""

VERBS: tuple[str, ...] = (
    # one line each, a dash in a verb being an underscore in its module
    "calibrate",
    "record",
    "identify",
    "noise",
    "design",
    "check",
    "wordlength",
    "build",
    "image",
    "firmware",
    "measure",
    "disturb",
    "experiment",
    "waveforms",
    "render",
    "play",
    "corpus",
    "reproduce",
)
