"""What connections may do to a server: so many of them at once, and whatever they say."""
