"""Estimators of plant models: starts, descent, prediction, covariance."""
