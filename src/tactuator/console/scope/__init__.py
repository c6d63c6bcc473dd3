"""The scope of the console: the newest samples of a rig, and what a page may do with them and with the rig."""
