"""What every refusal of the command line looks like."""

from pathlib import Path

import pytest

from tactuator.cli import main


def refused(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str], folder: Path, status: int = 2
) -> None:
    """That status, one line on standard error with those words, nothing on standard output or new in the folder.

    FOLDER in an argument stands for that folder.
    """
    before = sorted(folder.rglob("*"))
    assert main([word.replace("FOLDER", str(folder)) for word in arguments]) == status
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("tactuator: ")
    assert words in err
    assert sorted(folder.rglob("*")) == before
