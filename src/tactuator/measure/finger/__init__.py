"""Estimation of what touches a display: its impedance from play, free and touched, and the weights that were learnt."""
