"""C text of a block: expressions, kernel, struct layout, header, source.

Does a line decide what stands in the generated header or source? Then it lives here.
"""
