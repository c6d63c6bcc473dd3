"""The verbs for displays on sound cards."""
