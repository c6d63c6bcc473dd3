"""What is done to the store and to files: kills, power cuts, full disks, interrupts and hostile files."""
