"""Does it read or write a file that a person opens: of a vehicle, a loop, equations, results?"""
