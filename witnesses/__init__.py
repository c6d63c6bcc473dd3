"""Programs that make the figures of a claim with something that the claim's own code does not share; run by hand."""
