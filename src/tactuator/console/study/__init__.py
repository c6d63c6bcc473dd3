"""A study at the console's rig: the rig as an experiment sees it, the study that is open, and its exports."""
