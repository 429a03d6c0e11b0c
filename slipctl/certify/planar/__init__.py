"""Sets of one error, alone or behind an actuator with a lag and a dead time.

Does it hold one error inside bounds, whatever the law's shape?
"""
