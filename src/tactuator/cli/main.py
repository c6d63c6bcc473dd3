"""The main program: finds the command, runs it, and turns what went wrong into one line and an exit status."""

import atexit
import os
import re
import signal
import sys
import textwrap
import traceback
from collections.abc import Container, Sequence
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import NoReturn

import typer
from typer.exceptions import TyperException

from tactuator.cli.app import build_app
from tactuator.cli.commands import GROUPS, subcommands, top_commands
from tactuator.entry_points import plugin_fault
from tactuator.errors import BadInput, Interrupted, TactuatorError, unknown, visible

DONE, BAD_INPUT, OWN_FAULT, INTERRUPTED, TERMINATED = 0, 2, 70, 130, 143
_AGAIN_S = 0.02
"""Time after which an end that was swallowed is raised again; by then the callback is over."""


class _Ear:
    """The handler of Ctrl-C. It remembers that one came: a library may turn it into another error."""

    came = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.came = True
        signal.default_int_handler(number, frame)


def needed(arguments: Sequence[str]) -> Container[str]:
    """Return the commands that may be run with these arguments, or completed in a shell's line: the one that is named.

    Raises BadInput for a command that is not there, with the likely one.
    """
    completing = "_TACTUATOR_COMPLETE" in os.environ
    if completing:
        line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
        arguments = line.split()[1:]
    words = [argument for argument in arguments if not argument.startswith("-")]
    if words and not completing:
        known = top_commands()
        if words[0] not in known:
            raise unknown("command", words[0], known)
        if len(arguments) == 1 and words[0] in GROUPS:
            raise BadInput(f"{words[0]}: no subcommand is named", ", ".join(subcommands(words[0])))
        if words[0] in GROUPS and len(words) > 1 and words[1] not in subcommands(words[0]):
            raise unknown(f"{words[0]} command", words[1], subcommands(words[0]))
    return (*words[:1], " ".join(words[:2]))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status; nothing is raised but what the interpreter itself raises."""
    if arguments is not None:
        return _status_of(arguments)
    signal.signal(signal.SIGTERM, _terminate)
    sys.unraisablehook = _raise_again
    try:
        if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # `tactuator.__main__` held it so far
            signal.signal(signal.SIGINT, _Ear())
        status = _status_of(sys.argv[1:])
    except KeyboardInterrupt:  # between two lines of `_status_of`
        status = _say("interrupted", INTERRUPTED)
    finally:
        # All is done: a late Ctrl-C would only kill the interpreter while it tidies up, without a word.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGALRM, signal.SIG_IGN)
    sound = sys.modules.get("tactuator.rig.sound.cards")
    if sound is not None and sound.PORTAUDIO.lost:
        _leave_at_once(status)
    return status


def _leave_at_once(status: int) -> NoReturn:
    """End the process after Python's exit handlers and without those of the libraries in C: one that hangs in a thread
    may hold what its exit handler waits for.
    """
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


SOLE_PROCESSOR = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
"""Variables that make the libraries beneath NumPy use one thread, if set before they are loaded."""


def _status_of(arguments: Sequence[str]) -> int:
    # The matrices here are small: a second thread would spin for nothing, and change last digits.
    for variable in SOLE_PROCESSOR:
        os.environ.setdefault(variable, "1")
    try:
        app = build_app(needed(arguments))
        status = app(args=arguments, prog_name="tactuator", standalone_mode=False)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return _say("interrupted", INTERRUPTED)
    except Exception as error:
        ear = signal.getsignal(signal.SIGINT)
        if isinstance(error, typer.Abort) or (isinstance(ear, _Ear) and ear.came and type(error) is not Interrupted):
            return _say("interrupted", INTERRUPTED)
        return _say_what_failed(error, arguments)
    if status == INTERRUPTED:  # typer's own rendering of Ctrl-C
        return _say("interrupted", INTERRUPTED)
    return status if isinstance(status, int) else DONE


def _say_what_failed(error: Exception, arguments: Sequence[str]) -> int:
    """Say in one line what went wrong, a defect of the program's own with its traceback; return the exit status."""
    match error:
        case TactuatorError():
            return _say(str(error), error.exit_status, error.lines[1:])
        case TyperException():
            return _say(_usage(error, arguments), BAD_INPUT)
        case BrokenPipeError():
            # The reader has gone; give the interpreter's last flush somewhere to go.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return DONE
        case OSError():
            return _say(_os_error(error), BAD_INPUT)
    fault = plugin_fault(error)
    if fault is not None:
        return _say(str(fault), fault.exit_status)
    traceback.print_exception(error)
    return OWN_FAULT


def _say(message: str, status: int, notes: Sequence[str] = ()) -> int:
    """Print one line on standard error, whatever the message holds, and its notes; return the exit status."""
    sys.stderr.write(f"tactuator: {visible(' '.join(message.split()))}\n")
    for note in notes:
        sys.stderr.write(textwrap.fill(note, 79, initial_indent="  ", subsequent_indent="    ") + "\n")
    return status


_ENGLISH = {
    r"Input should be a valid integer, .*": "it must be a whole number",
    r"Input should be a valid number, .*": "it must be a number",
    r"Input should be greater than or equal to (\S+)": r"it must be at least \1",
    r"Input should be less than or equal to (\S+)": r"it must be at most \1",
    r"Input should be (greater|less) than (\S+)": r"it must be \1 than \2",
}
"""What pydantic says of a value, and what is said here."""
_SURPLUS = re.compile(r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)")


def _usage(error: TyperException, arguments: Sequence[str]) -> str:
    """Return what is wrong with the arguments in one sentence: what was given, and what helps."""
    message, context = error.format_message(), getattr(error, "ctx", None)
    if context is not None and (surplus := _SURPLUS.fullmatch(message.rstrip("."))):
        given = surplus[1].split()
        takes = [each.name for each in context.command.params if each.param_type_name == "argument"]
        options = {name for each in context.command.params for name in each.opts if name.startswith("--")}
        meant = [f"{name} {one}" for one in given if (name := f"--{Path(one).stem}") in options]
        likely = f" (did you mean {', '.join(meant)}?)" if meant else ""
        message = f"unexpected {' '.join(given)}{likely}; expected {', '.join(takes) or 'options alone'}"
    for pydantic, ours in _ENGLISH.items():
        message = re.sub(pydantic, ours, message)
    return message + _got(error, arguments) + _help_for(error)


def _got(error: TyperException, arguments: Sequence[str]) -> str:
    """Name the value that an option refused, where typer's own message does not."""
    names = getattr(getattr(error, "param", None), "opts", ())
    for option, value in pairwise(arguments):
        if option in names and value not in error.format_message():
            return f" (got {value!r})"
    return ""


def _help_for(error: TyperException) -> str:
    """Name the help to read, where the message is not about a value and so does not say what is allowed."""
    context = getattr(error, "ctx", None)
    if context is None or error.format_message().startswith("Invalid value"):
        return ""
    return f" (`{context.command_path} --help` lists what it takes)"


def _os_error(error: OSError) -> str:
    files = [str(name) for name in (error.filename, error.filename2) if name is not None]
    return ": ".join([*files, error.strerror or str(error) or type(error).__name__])


def _raise_again(raised: "sys.UnraisableHookArgs") -> None:
    """Raise an end that was swallowed once more, a moment later; report anything else as the interpreter does.

    A Ctrl-C may come while a library calls Python back, from where no exception can leave: the interpreter would print
    it, and the command would go on.
    """
    ends = {KeyboardInterrupt: signal.SIGINT, SystemExit: signal.SIGTERM}
    if raised.exc_type not in ends:
        sys.__unraisablehook__(raised)
        return
    again = ends[raised.exc_type]
    signal.signal(signal.SIGALRM, lambda number, frame: signal.raise_signal(again))
    signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)


def _terminate(number: int, frame: FrameType | None) -> None:
    """Leave through the `finally` clauses, so that nothing half-written stays."""
    raise SystemExit(TERMINATED)
