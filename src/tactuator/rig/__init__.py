"""Rigs: things that run a controller and can be touched. Simulated here, on boards elsewhere, one protocol."""
