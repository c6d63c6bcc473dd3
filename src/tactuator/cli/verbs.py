"""The verbs of the command line, in the order of the chain: each is a module `tactuator.cli.<verb>`."""

VERBS: tuple[str, ...] = (
    # one line each, a dash in a verb being an underscore in its module
    "design",
    "check",
    "wordlength",
    "build",
    "firmware",
    "reproduce",
    "experiment",
    "identify",
    "render",
    "play",
    "corpus",
    "waveforms",
    "record",
    "measure",
    "disturb",
    "noise",
    "calibrate",
)
