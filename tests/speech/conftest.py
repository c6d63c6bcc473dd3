"""Sound files for speech tests."""

from pathlib import Path

import numpy as np
import pytest
import soundfile


@pytest.fixture
def write_sound(tmp_path):
    """Writes samples as a sound file beneath the test's folder and returns its path."""

    def write(samples, rate_hz=16000, name="speech.wav", subtype=None) -> Path:
        path = tmp_path / name
        soundfile.write(path, np.asarray(samples), rate_hz, subtype=subtype)
        return path

    return write
