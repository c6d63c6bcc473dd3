"""Files to start from: examples that are shipped, and a display file or a protocol made from one of them."""
