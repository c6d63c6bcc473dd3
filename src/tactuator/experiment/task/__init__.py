"""Tasks of judging: matching, magnitude estimation, discrimination, and those of other packages."""
