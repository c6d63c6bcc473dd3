"""The database of an experiment: schema, records, runs ready for analysis."""
