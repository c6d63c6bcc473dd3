"""The database of an experiment: schema, migrations, records, exports."""
