"""The navigation of each page is made of titles alone, which halves the time of a build.

Sphinx copies every heading of every page for each page, and drops all but the titles.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from docutils import nodes


def titles_of(env: Any) -> dict[str, nodes.Node]:
    """Contents of each page, its title alone."""
    found = {}
    for page, contents in env.tocs.items():
        short = contents.copy()
        for entry in contents.children[:1]:
            title = entry.copy()
            title += entry.children[0].deepcopy()
            short += title
        found[page] = short
    return found


def tree_of_titles(env: Any, titles: Any, whole: Any, *args: Any, **kwargs: Any) -> str:
    """Navigation as the builder makes it, of the titles where nothing else is asked for."""
    if not kwargs.get("titles_only"):
        return str(whole(*args, **kwargs))
    contents, env.tocs = env.tocs, titles
    try:
        return str(whole(*args, **kwargs))
    finally:
        env.tocs = contents


def shorten(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Hand the theme a tree of titles; at the first page they are gathered."""
    if "toctree" not in context:
        return
    if not hasattr(app, "titles"):
        app.titles = titles_of(app.env)
    context["toctree"] = partial(tree_of_titles, app.env, app.titles, context["toctree"])


def setup(app: Any) -> dict[str, bool]:
    """Come before the theme, whose priority is 500."""
    app.connect("html-page-context", shorten, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
