"""Witnesses of the felt level under a finger: a device of their own around the product's controller."""
