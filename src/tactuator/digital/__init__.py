"""From continuous systems to what a processor runs: discretisation, images, word length, and the core's binding."""
