"""Design and test tactile displays that feel equally strong at every frequency.

`import tactuator as tt` gives the functions of the API by name; each is imported when it is first used.
`__init__.pyi` has their types. In the order of the chain:
"""

from importlib import import_module

_CHAIN = (
    (
        "start",
        {
            "api.start": (
                *(
                    "init",
                    "examples",
                    "curves",
                    "read_display",
                    "read_record",
                    "read_response",
                    "read_curve",
                    "read_model",
                ),
            )
        },
    ),
    ("describe", {"model.description": ("Display", "Channel"), "model.plant": ("Load",)}),
    ("model", {"api.model": ("calibrate_sensor", "record", "identify")}),
    (
        "controller",
        {
            "api.controller": ("design", "check", "word_length", "build_image", "read_image"),
            "api.start": ("read_controller",),
            "signals.exchange": ("to_control", "from_control"),
        },
    ),
    ("rig", {"rig.open": ("open_rig",), "rig.simulated": ("SimulatedRig",), "api.sound": ("calibrate_display",)}),
    (
        "measure",
        {
            "api.response": (
                *("measure_response", "measure_noise", "measure_crosstalk", "measure_rejection", "estimate_load"),
            ),
            "io.response": ("read_responses",),
        },
    ),
    ("speech", {"api.speech": ("render", "play"), "api.listen": ("listen",), "api.items": ("waveforms",)}),
    ("people", {"api.experiment": ("simulate", "observe", "thresholds")}),
    ("paper", {"paper.reproduce": ("reproduce",)}),
    (
        "errors",
        {
            "errors": (
                *("TactuatorError", "BadInput", "NoDesign", "DeviceFault", "TimingMissed", "StoreFault"),
                "Interrupted",
            ),
            "entry_points": ("PluginFault",),
            "signals.loop": ("UnstableLoop",),
            "measure.open_loop": ("NoEqualiser",),
            "rig.transport": ("LinkDown",),
            "rig.board.link": ("LinkGarbled", "RigFault", "RigIncomplete", "RigLocked"),
            "rig.board.stream": ("StreamDry",),
            "rig.sound.stream": ("CardGone", "SoundGap"),
        },
    ),
)
"""The names that the package offers, by chapter and module."""
_MODULES = {name: module for _, modules in _CHAIN for module, names in modules.items() for name in names}
__all__ = [*_MODULES]
__doc__ += "".join(f"\n    {chapter:11} {', '.join(sum(modules.values(), ()))}" for chapter, modules in _CHAIN)


def __getattr__(name: str) -> object:
    """Return what is asked for by name, and remember it."""
    if name == "__version__":
        value: object = import_module("importlib.metadata").version("tactuator")
    elif name in _MODULES:
        value = getattr(import_module(f"tactuator.{_MODULES[name]}"), name)
        if not isinstance(value, type):
            value = import_module("tactuator.parameters").checked(value)
    else:
        raise AttributeError(f"module 'tactuator' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the names that the package offers."""
    return sorted([*_MODULES, "__version__"])
