"""Does it fit a flow to a log over time?"""
