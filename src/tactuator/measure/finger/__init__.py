"""What touches a display: its impedance from play, free and touched, and whether one mass, damper and spring it is."""
