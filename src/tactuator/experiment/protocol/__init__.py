"""Protocol files, which a laboratory writes before an experiment, and the plan of sessions."""
