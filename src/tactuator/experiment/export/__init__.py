"""Export of a store in open formats, for R and for reviewers."""
