"""What an end that a subject asks for takes, at the finger."""
