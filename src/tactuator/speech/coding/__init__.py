"""Codings of speech for fingers: bands, envelopes, carriers and their files."""
