"""The verb of the whole study: reproduce."""
