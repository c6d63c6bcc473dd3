"""The verbs of the command line, in the order of the chain: each is a module `tactuator.cli.<verb>`."""

VERBS: tuple[str, ...] = ()
