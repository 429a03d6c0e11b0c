"""Does it look for the numbers of a law, or say what numbers that were found are worth?

``tuning`` searches, ``goals`` says what is wanted, ``promises`` what is proved, ``judging`` what
the numbers are worth on draws that the search has not seen.
"""
