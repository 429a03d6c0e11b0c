"""Method "cells with modes": state machines behind a brake.

Does it prove that a set of cells is never left?
"""
