"""A board at the far end of the link: the rig, its finger, its stream, its tones, its commissioning."""
