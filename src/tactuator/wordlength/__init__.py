"""Effects of a number format on a controller: coefficients, round-off, bits needed, verdict."""
