"""What can be open? A file, study or loop, a folder of a sweep, a recorded log."""
