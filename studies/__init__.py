"""Studies: one question each, runnable by name."""
