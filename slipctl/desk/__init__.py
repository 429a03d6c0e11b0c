"""Files of one's own: what a person wrote as a table, read as the parts that are declared.

Does a line turn a table into declared parts, or say what a file may hold? Then it lives here. What
the parts are is declared by the models; nothing here knows a vehicle.
"""
