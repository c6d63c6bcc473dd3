"""A finished model as a fit: what it makes of another record's lines, transients included."""

from __future__ import annotations

import numpy as np

from tactuator.identification.forms.form import Form, ladder, numerator_polynomial, sections_of
from tactuator.identification.spectral.hold import Grid, Hold
from tactuator.identification.spectral.likelihood import SpectralFit
from tactuator.model.plant_model import PlantModel


def fit_of_model(model: PlantModel, rate_hz: float, hold: Hold, gain: float) -> SpectralFit:
    """Return the model as a fit whose command and position are scaled: gain is position's unit over command's."""
    poles, zeros = np.roots(model.den), model.num.size - 1
    size = np.abs(poles[poles != 0.0])
    scale = float(np.exp(np.mean(np.log(size)))) if size.size else rate_hz
    form = Form(poles.size, zeros, dead_time=True)
    theta = sections_of(poles / scale)
    rungs = ladder(theta, form)
    basis = np.stack([numerator_polynomial(rungs, row, form) for row in np.eye(zeros + 1)], axis=1)
    powers = poles.size - np.arange(zeros, -1, -1.0)
    numerator = np.asarray(np.linalg.solve(basis, model.num / gain / scale**powers), dtype=np.float64)
    grid = Grid(np.zeros(0), rate_hz, scale, hold)
    return SpectralFit(form, theta, model.delay_s * scale, numerator, rungs, grid, 0.0)
