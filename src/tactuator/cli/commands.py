"""The commands by name, in groups in the order of the chain: each with its function and its help sentence.

A name of two words is a subcommand of the first. The sentence is the first one of the function's docstring (a test
compares the two): `--help` needs none of the modules, and a command imports only the module of its function.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class Command:
    """A command: its name, its function ("module:function" below tactuator), its sentence and its group."""

    name: str
    place: str
    sentence: str
    group: str

    def function(self) -> Callable[..., Any]:
        """Import the function."""
        module, _, name = self.place.partition(":")
        function: Callable[..., Any] = getattr(import_module(f"tactuator.{module}"), name)
        return function

    def load(self) -> Callable[..., None]:
        """Import the function and what makes a command of it."""
        command: Callable[..., None] = import_module("tactuator.cli.command").command_of(self.function())
        return command


_START, _PAGE, _MODEL = "Files to start from", "The chain on a page", "From a record to a model"
_BOARD, _DISPLAY, _SOUND = "From a model to a controller on a board", "What the display does", "Displays on sound cards"
_PERSON, _SPEECH, _PAPER = "What a person feels", "Speech", "The paper"

_ROWS = (
    (_START, "init", "api.start:init", "Write a display file to start from, or copy the examples."),
    (_PAGE, "console", "console.serve:console", "Serve a page to shape a loop, and to drive a rig."),
    (_MODEL, "calibrate", "api.model:calibrate_sensor", "Find the sensor gain from displacement and voltage."),
    (_MODEL, "record", "api.model:record", "Drive one channel and record."),
    (_MODEL, "identify", "api.model:identify", "Identify a model of a recorded mechanism."),
    (_BOARD, "design", "api.controller:design", "Design loop and prefilter of every channel."),
    (_BOARD, "check", "api.controller:check", "Judge a controller by the paper's four objectives."),
    (_BOARD, "firmware wordlength", "api.controller:word_length", "Count the bits that the coefficients need."),
    (_BOARD, "build", "api.controller:build_image", "Write a controller as the image that a board loads."),
    (_BOARD, "firmware image", "api.controller:read_image", "Show what a firmware image contains."),
    (_BOARD, "firmware acknowledge", "api.controller:acknowledge", "Acknowledge sensor faults on a board."),
    (_DISPLAY, "measure noise", "api.response:measure_noise", "Compare felt hum and noise with the threshold."),
    (_DISPLAY, "measure response", "api.response:measure_response", "Measure the response at a level."),
    (_DISPLAY, "measure crosstalk", "api.response:measure_crosstalk", "Measure what other fingers feel."),
    (_DISPLAY, "measure disturbance", "api.response:measure_rejection", "Test how presses and tremor are rejected."),
    (_DISPLAY, "measure load", "api.response:estimate_load", "Estimate the impedance of the touching finger."),
    (_SOUND, "sound devices", "api.sound:devices", "Show the sound cards."),
    (_SOUND, "sound latency", "api.sound:latency", "Measure the delay through a wire."),
    (_SOUND, "sound calibrate", "api.sound:calibrate_output", "Turn a multimeter's reading into volts at full scale."),
    (_SOUND, "sound calibrate-display", "api.sound:calibrate_display", "Calibrate a display without loop."),
    (_PERSON, "curves", "api.start:curves", "List the threshold curves of the library, and your own."),
    (_PERSON, "experiment check", "api.experiment:check_protocol", "Check whether a study can come to results."),
    (_PERSON, "experiment serve", "web.serve:serve", "Serve the study to browsers."),
    (_PERSON, "experiment enrol", "api.experiment:enrol", "Add a subject, or a further visit of one."),
    (_PERSON, "experiment correct", "api.experiment:correct", "Correct the data of a subject or a visit."),
    (_PERSON, "experiment rename", "api.experiment:rename", "Give a subject another code."),
    (_PERSON, "experiment void", "api.experiment:void", "Leave a visit, run or trial out of all results."),
    (_PERSON, "experiment erase", "api.experiment:erase", "Erase everything of a subject from a store."),
    (_PERSON, "experiment observe", "api.experiment:observe", "Run simulated subjects through a study."),
    (_PERSON, "experiment thresholds", "api.experiment:thresholds", "Refit thresholds of every finished run."),
    (_PERSON, "experiment contours", "api.strength:contours", "Estimate equal-strength contours from matches."),
    (_PERSON, "experiment judged", "api.strength:judged", "Summarise the results of a judging task."),
    (_PERSON, "experiment export", "api.experiment:export", "Write every answered trial in an open format."),
    (_PERSON, "experiment waveforms", "api.items:waveforms", "Write waveforms and a protocol that asks for them."),
    (_PERSON, "experiment phonemes", "api.items:phonemes", "Write TAPS's phonemes and a protocol for them."),
    (_PERSON, "experiment recognise", "api.recognition:recognise", "Run a recognition experiment with a subject."),
    (_PERSON, "experiment information", "api.recognition:information", "Estimate information transfer in five ways."),
    (_PERSON, "experiment backup", "api.experiment:backup", "Copy a store whole, also while it is served."),
    (_PERSON, "experiment merge", "api.experiment:merge", "Copy several stores into a new one."),
    (_PERSON, "experiment simulate", "api.experiment:simulate", "Assess how accurate a procedure's estimates are."),
    (_SPEECH, "render", "api.speech:render", "Render speech, clips or phonemes to a reference in dB SL."),
    (_SPEECH, "play", "api.speech:play", "Play a reference."),
    (_SPEECH, "listen", "api.listen:listen_until_it_ends", "Let fingers feel sound as it comes."),
    (_PAPER, "reproduce", "paper.reproduce:reproduce", "Run the paper's study on the simulated display."),
)  # fmt: skip
COMMANDS = {name: Command(name, place, sentence, group) for group, name, place, sentence in _ROWS}

GROUPS = {
    "firmware": "Look into images, and at a board's faults.",
    "measure": "Measure response, noise, crosstalk, disturbance, load.",
    "sound": "Calibrate sound cards and the displays on them.",
    "experiment": "Run, simulate, analyse and export experiments.",
}
"""Commands that have subcommands, each with its sentence."""

FIRST = ("init", "calibrate", "identify", "design", "check", "measure", "experiment", "render")
"""Commands that a newcomer needs."""


def top_commands() -> tuple[str, ...]:
    """Return the first words of all commands, in the order of the chain."""
    return tuple(dict.fromkeys(name.partition(" ")[0] for name in COMMANDS))


def subcommands(name: str) -> tuple[str, ...]:
    """Return the subcommands of a command, none where it has none."""
    return tuple(full.partition(" ")[2] for full in COMMANDS if full.startswith(f"{name} "))
