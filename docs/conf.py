"""The site of these pages: ``sphinx-build -W docs out/docs`` (the ``docs`` extra)."""

import sys
from pathlib import Path

from slipctl import __version__

sys.path.insert(0, str(Path(__file__).parent))  # the extensions stand here

project = "slipctl"
author = "slipctl developers"
version = release = __version__
extensions = ["myst_parser", "model_pages", "navigation", "pictures", "terms"]
# equations are MathML, which browsers know: no MathJax, so nothing is loaded from the network
myst_heading_anchors = 4
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["site.css"]
templates_path = ["templates"]
html_sidebars = {"**": ["sidebar/brand.html", "sidebar/search.html", "sidebar/scroll-start.html",
                        "sidebar/navigation.html", "sidebar/versions.html",
                        "sidebar/scroll-end.html"]}  # fmt: skip
html_title = f"slipctl {release}"
html_show_sourcelink = html_copy_source = False  # the wheel ships at most 10 MB
exclude_patterns = ["evidence", "made"]
