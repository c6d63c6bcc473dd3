"""Tactile displays on which equal reference amplitude is felt equally strongly at every frequency.

`import tactuator as tt` gives the functions of the API by name; each is imported when it is first used.
`__init__.pyi` has their types.
"""

from importlib import import_module

_ROOMS = {
    "errors": ("BadInput",),
    "paper.reproduce": ("reproduce",),
    "rig.open": ("open_rig",),
    "rig.simulated": ("SimulatedRig",),
    "api.controller": ("build", "check", "design", "image"),
    "api.experiment": ("thresholds",),
    "api.items": ("waveforms",),
    "api.model": ("calibrate", "identify", "record"),
    "api.response": ("crosstalk", "disturb", "finger", "measure_response", "noise"),
    "api.sound": ("calibrate_display",),
    "api.speech": ("play", "render"),
    "api.start": (
        "examples", "init", "read_controller", "read_curve", "read_display", "read_model", "read_record",
    ),
}  # fmt: skip
_NAMES = {name: room for room, names in _ROOMS.items() for name in names}


def __getattr__(name: str) -> object:
    """Return what is asked for by name, and remember it."""
    if name == "__version__":
        value: object = import_module("importlib.metadata").version("tactuator")
    elif name in _NAMES:
        value = getattr(import_module(f"tactuator.{_NAMES[name]}"), name)
        if not isinstance(value, type):
            value = import_module("tactuator.parameters").checked(value)
    else:
        raise AttributeError(f"module 'tactuator' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the names that the package offers."""
    return sorted([*_NAMES, "__version__"])
