"""The views beside the loop's: the requests of each, and how they are answered."""
