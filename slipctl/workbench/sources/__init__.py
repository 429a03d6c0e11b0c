"""What can be open: a file, study or loop, a folder of a sweep, a recorded log."""
