"""Errors that tactuator raises on purpose, each with the exit status that the command line ends with.

    TactuatorError
    ├── BadInput       2   input that cannot be used
    │   └── UnstableLoop   a loop is unstable, so that what was asked of it has no answer (loop)
    ├── NoDesign       2   no controller keeps what was asked for
    │   └── NoEqualiser    for what was measured; it holds that (measure/open_loop)
    ├── DeviceFault    3   a rig, a link or a sound card failed
    │   ├── LinkDown       the other end of a link does not answer (rig/transport)
    │   ├── LinkGarbled    a board answers what is no answer (rig/board)
    │   ├── RigFault       the guard of a board ended the run (rig/board)
    │   ├── RigLocked      a board is locked out until its faults are acknowledged (rig/board)
    │   ├── CardGone       a sound card does not call back any more (rig/sound)
    │   ├── NotJudged      a check could not tell, since the machine was busy (rig/board_check)
    │   └── TimingMissed   a stretch of time was not what was asked for, and may be asked for again
    │       ├── StreamDry      a stream ran dry (rig/board)
    │       └── SoundGap       a run on a sound card had a gap (rig/sound)
    └── StoreFault     2   the database of an experiment cannot be read or written

Every message is one line: what was got, and what is allowed.
"""


class TactuatorError(Exception):
    """An error with a message of one line for the person who asked; `exit_status` is the command line's."""

    exit_status = 2


class BadInput(TactuatorError, ValueError):
    """Input that cannot be used; the message tells what was got and what is allowed."""


class NoDesign(TactuatorError, ValueError):
    """No controller keeps the limits that were asked for; the message tells which limits bind."""


class DeviceFault(TactuatorError):
    """A device failed while it was in use; the input was not at fault."""

    exit_status = 3


class TimingMissed(DeviceFault):
    """A rig did not play what it was given at its time; the same may be asked for again."""


class StoreFault(TactuatorError):
    """The database of an experiment cannot be read or written; nothing was changed."""
