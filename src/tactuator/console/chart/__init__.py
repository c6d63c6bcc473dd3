"""The curves, regions and figures that the loop view draws, as functions of a channel and a controller."""
