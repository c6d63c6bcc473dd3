"""What a laboratory writes down before an experiment: protocol files and the plan of sessions."""
