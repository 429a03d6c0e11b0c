"""The world and the roll: rails, scenarios, compiled loops, simulation, metrics, files.

Does a line say what happens to a loop, roll it over time, measure the log, or keep it in a file?
Then it lives here.
"""
