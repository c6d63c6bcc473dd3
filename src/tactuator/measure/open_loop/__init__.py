"""A display without loop from nothing to a verified equaliser: level, record, model, usable band, felt flatness."""
