"""Method "sums", and the tube: smooth loops of many states near their rest.

Does it prove what each tick adds to a linear loop?
"""
