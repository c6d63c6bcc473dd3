"""A sound card that is none: a JACK server without hardware, and simulated exciters between its ports."""
