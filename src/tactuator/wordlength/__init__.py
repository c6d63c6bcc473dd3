"""What a number format leaves of a controller: coefficients, round-off, bits needed, verdict."""
