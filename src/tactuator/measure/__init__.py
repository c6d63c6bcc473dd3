"""What a display does, measured on any rig: responses, disturbances, noise, and what is felt of a reference."""
