"""Does it say what a stage of an optimal control problem is: equations, slopes, length?"""
