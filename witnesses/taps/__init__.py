"""A tactile speech code against its published form, and how strongly its phonemes are felt."""
