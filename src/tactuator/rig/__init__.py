"""Rigs that run a controller and can be touched: simulated here, on boards elsewhere, under one protocol."""
