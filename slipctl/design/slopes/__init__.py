"""Does it need the slopes of a run by its numbers?"""
