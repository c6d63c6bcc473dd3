"""Ways to carry the link's bytes: in this process, an emulator, a serial port, a socket."""
