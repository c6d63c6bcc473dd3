"""Maximum likelihood in the frequency domain, for held and for band-limited commands, with transient terms."""
