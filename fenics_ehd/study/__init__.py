"""Error against run time: every reduction method against the full interface."""
