"""Everything a person sees of a block or a log: equations, diagrams, figures.

Does a line turn blocks or numbers into LaTeX, MathML, text, a diagram or a figure? Then it lives
here. ``matplotlib`` is imported in this room only.
"""
