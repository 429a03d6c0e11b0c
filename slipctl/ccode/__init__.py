"""C of a Block: expressions, kernel, struct layout, header, source, the files beside them."""
