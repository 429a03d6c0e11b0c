"""Ticks of any controller, read from Python or CasADi into operations.

Does it read a tick, enclose it, or prove a loop that is declared by it?
"""
