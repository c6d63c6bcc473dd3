"""Results computed from stored trials: thresholds, group curves, confusions, information."""
