"""From measured records to models: calibration, recursive and refined estimates, order, dead time, friction."""
