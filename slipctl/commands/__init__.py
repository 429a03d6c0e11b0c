"""The command line, one file per command.

Does a line read what a person typed, or print the answer? Then it lives here; the work is done in
the rooms below.
"""
