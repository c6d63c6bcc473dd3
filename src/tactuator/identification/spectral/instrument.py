"""A recorded reference as instrument: the part of a loop's command that follows it is free of the loop's own noise.

Source: Van den Hof and Schrama, An indirect method for transfer function estimation from closed loop data, 1993 (two
stages), with a local polynomial estimate for the first stage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactuator.arrays import FloatArray
from tactuator.identification.spectral.joined import join
from tactuator.identification.spectral.lines import Spectrum, band_edges, equations
from tactuator.identification.spectral.noise import weights
from tactuator.identification.spectral.search import Choice

_SHARE = 0.04
_FEWEST = 30
"""Lines of a band, of which six take part of the noise with them: a fifth at most."""
REMAINS = 0.3
"""Share of what the reference changed that may still be amiss: the bands' own six of thirty lines, and chance."""
_FOLLOWS = 0.3
"""Share of the command's power that must follow the reference for it to be of use."""


def choice_by_reference(choice: Choice, spectra: Sequence[Spectrum], references: Sequence[FloatArray]) -> Choice | None:
    """Return the choice with its forms fitted to what follows the references (n,); None where that is too little."""
    pairs = list(zip(spectra, references, strict=True))
    if not all(follows(*pair) for pair in pairs):
        return None
    given = join([equations(by_reference(*pair), 0.0, 0.5 * choice.problem.given.rate_hz) for pair in pairs])
    problem, fit = replace(choice.problem, given=given), choice.fit
    highest = float(given.of_hz[choice.problem.weight > 0.0].max())
    for _ in range(2):
        problem = problem.with_weight(weights(given, problem.residual(fit), highest))
        fit = problem.descend(fit.form, fit.theta, fit.delay, most=10) or fit
    others = {form: problem.descend(form, one.theta, one.delay, most=6) for form, one in choice.fits.items()}
    kept = {form: one for form, one in others.items() if one is not None}
    return replace(choice, fit=fit, problem=problem, fits=kept | {fit.form: fit})


def follows(taken: Spectrum, reference: FloatArray) -> bool:
    """Return true where enough of the command follows the reference (n,)."""
    made = by_reference(taken, reference)
    power = float(np.sum(np.abs(taken.command) ** 2))
    return float(np.sum(np.abs(made.command) ** 2)) > (_FOLLOWS + 6.0 / _FEWEST) * power


def by_reference(taken: Spectrum, reference: FloatArray) -> Spectrum:
    """Return the spectrum with the command's lines replaced by what follows the reference (n,), transient included."""
    early = reference[: taken.samples]
    driver = np.fft.rfft(early - early.mean()) / np.sqrt(taken.samples)
    command = taken.command.copy()
    for begin, end in band_edges(taken, 1, taken.command.size, _SHARE, _FEWEST, widest=1.0):
        place = np.linspace(-1.0, 1.0, end - begin)
        shape = np.stack([np.ones_like(place), place, place * place], axis=1)
        columns = np.hstack([driver[begin:end, None] * shape, shape])
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        basis, values, _ = np.linalg.svd(columns / size, full_matrices=False)
        basis = basis[:, values > 1e-9 * values[0]]
        command[begin:end] = basis @ (basis.conj().T @ taken.command[begin:end])
    return replace(taken, command=command)
