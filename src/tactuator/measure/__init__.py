"""What a display does, measured on any rig: responses, disturbances and noise."""
