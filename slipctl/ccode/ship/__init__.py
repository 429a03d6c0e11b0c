"""What a module is handed over as: FMU, A2L, its README and its report.

Does a line write something for another tool or for a reader? Then it lives here.
"""
