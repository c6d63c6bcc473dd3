"""A store in open formats, for R and for reviewers."""
