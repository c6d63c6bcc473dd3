"""The process that holds the rig: its orders, its generator, its measurements, and its end at rest."""
