"""The site of these pages: ``sphinx-build -W docs out/docs`` (the ``docs`` extra)."""

from slipctl import __version__

project = "slipctl"
author = "slipctl developers"
version = release = __version__
extensions = ["myst_parser"]
# equations are code in these pages: no MathJax, so nothing is loaded from the network
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"slipctl {release}"
html_show_sourcelink = False
exclude_patterns = ["evidence"]
