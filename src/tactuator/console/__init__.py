"""The console: one page on this machine for the chain, in which a loop is shaped by dragging it."""
