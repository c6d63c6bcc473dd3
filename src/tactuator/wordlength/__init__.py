"""Word length of a controller: the bits that its coefficients need, and what float32 does to it."""
