"""C of a block: its text, the program, the checks, and what is handed over.

Does a line serve the C of a controller? Then it lives here, in one of the four rooms: ``write``,
``compile``, ``check``, ``ship``; ``codegen`` is their front door.
"""
