"""The paper's own design: IMECE2004-59874, section 4, equations of C(s) and F(s); section 3 for P(s)."""

from tactuator.signals.systems import ContinuousSystem

PLANT = ContinuousSystem.from_polynomials([2875.0], [1.0, 94.0, 290.0])
"""P(s), command volts to sensor volts, index finger."""

FEEDBACK = ContinuousSystem.from_polynomials([12.264, 12.264 * 111.0, 12.264 * 530.0], [1.0, 260.0, 0.0])
"""C(s)."""

PREFILTER = ContinuousSystem.from_polynomials(
    [565.49, 565.49 * 199.81, 565.49 * 17923.0, 565.49 * 1.786e5], [1.0, 1420.0, 336711.0, 1.12e7, 1.01e8]
)
"""F(s), of unit gain at rest: multiply by the threshold voltage at rest for a reference in threshold units."""

PREFILTER_POLES = 4
"""Of the paper's F."""
