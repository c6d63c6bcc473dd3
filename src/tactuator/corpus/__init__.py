"""Many files on many workers: the same job for each, whatever computes it."""
