"""Does the position follow the command's cube? An amplifier that saturates behind the recorded command shows so."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactuator.identification.spectral.lines import Spectrum
from tactuator.identification.spectral.record_residual import Residual

_CERTAIN = 100.0
"""Drop of -2 log likelihood by one parameter from which on the cube is taken to have a part."""
_SHARE = 0.02
"""Share of the residual from which on it is worth a word."""
_FLAT = 1e-3
"""Power of the cube, over that of the command's, below which its levels are too few to tell it from the command."""


def cubic_share(spectra: Sequence[Spectrum], residuals: Sequence[Residual]) -> float:
    """Return the share of the residuals' weighted power that the command's cube, moved as the model moves the command,
    explains; zero where chance would.

    Of the cube the part along the command is taken off (Bussgang, 1952): the model has it already.
    """
    size = along = total = 0.0
    for taken, left in zip(spectra, residuals, strict=True):
        command = np.fft.irfft(taken.command, taken.samples) * np.sqrt(taken.samples)
        square = command * command
        power = float(np.mean(square))
        cube = (square - float(np.mean(square * square)) / max(power, 1e-300)) * command
        if float(np.mean(cube**2)) < _FLAT * power**3:
            continue
        lines = np.fft.rfft(cube - cube.mean())[1:] / np.sqrt(taken.samples)
        pull = left.response * taken.ahead * lines * left.weight[1:]
        rest = left.lines[1:] * left.weight[1:]
        size += float(np.sum(np.abs(pull) ** 2))
        along += float(np.sum((np.conj(pull) * rest).real))
        total += float(np.sum(np.abs(rest) ** 2))
    if size <= 0.0 or total <= 0.0 or 2.0 * along**2 / size < _CERTAIN:
        return 0.0
    share = along**2 / (size * total)
    return share if share > _SHARE else 0.0
