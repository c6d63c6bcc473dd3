"""The evidence that a record shows before any model: checks, excitation, empirical response, residuals, hum."""
