"""Work on many files by many workers: the same job for each, whatever computes it."""
