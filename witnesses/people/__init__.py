"""People: honest ones and guessers drawn by a generator of its own, and what is told of them."""
