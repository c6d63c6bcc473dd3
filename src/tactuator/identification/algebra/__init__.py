"""Linear algebra of least squares that identification shares."""
