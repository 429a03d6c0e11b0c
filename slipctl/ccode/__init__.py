"""C of a block: its text, the program, the checks, and what is handed over.

Does a line serve the C of a controller? Then it lives in a room here; ``codegen`` is their
front door. What is written whole, as a test program or a Makefile, is a file in ``templates``.
"""
