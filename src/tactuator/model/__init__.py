"""The display: its channels, their models, and what touches them."""
