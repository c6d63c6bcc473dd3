"""Work on many files by many workers, each of which does the same job."""
