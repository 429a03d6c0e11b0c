"""A question and its answers: declaration, running, judging claims, the report.

Does a line know what a study, a loop by its name, a claim or a report is? Then it lives here.
"""
