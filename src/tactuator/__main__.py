"""The program's first lines, of `tactuator` and of `python -m tactuator`: they hold Ctrl-C while the rest loads."""

import gc
import os
import signal
import sys
from types import FrameType

_INTERRUPTED = 130


def main() -> int:
    """Run the command line and return its exit status.

    Until `tactuator.cli.main` is loaded, Ctrl-C ends the process at once, in one line: an exception would leave from
    the middle of an import as a traceback, or be printed and passed over in a callback of the import machinery. A
    process that was started without an ear for Ctrl-C (in the background of a script) keeps none.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    gc.set_threshold(10_000)  # by the interpreter's own 700 it looks for garbage all the time that modules load
    from tactuator.cli.main import main as run  # noqa: PLC0415 -- not before the handler is set

    status = run()
    gc.freeze()  # or it would look through all that stays once more, at the end
    return status


def _leave(number: int, frame: FrameType | None) -> None:
    """End the process: nothing is open yet that would need tidying."""
    os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, b"tactuator: interrupted\n")
    os._exit(_INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
