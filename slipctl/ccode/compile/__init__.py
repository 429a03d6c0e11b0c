"""What makes a program of the text: compilers, boards, the files beside the source, the library.

Does a line call a compiler, know a processor, or write a file of the folder? Then it lives here.
"""
