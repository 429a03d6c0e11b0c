"""Write docs/api.md from the docstrings: ``python docs/tools/make_api.py [--check]``."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from made import made

import slipctl
import slipctl.models
from slipctl.study import resolve

PAGE = Path(__file__).parents[1] / "api.md"

HEAD = """\
# API reference

Made from the docstrings by `python docs/tools/make_api.py`; a test fails when it is out of date.
Public is what `slipctl` exports; figures, the modules of bounds and the models are listed after it.
Units are SI. The ideas behind the names are in [concepts](concepts.md).
"""

SECTION = re.compile(r"^(Args|Returns|Raises|Yields|Attributes|Kinds|Proof note):\s*(.*)$")


def page() -> str:
    """Text of the page."""
    parts = [HEAD]
    for module, names in slipctl._WHERE.items():
        found = importlib.import_module(f"slipctl.{module}")
        parts.append(f"## slipctl.{module}\n\n{first_line(found)}\n")
        parts += [entry(name, getattr(found, name), 3) for name in names]
    figures = importlib.import_module("slipctl.draw.plots")
    parts.append(f"## slipctl.draw.plots\n\n{first_line(figures)}\n")
    parts += [entry(k, v, 3) for k, v in own(figures)]
    for title, package in (("Bounds", "slipctl.certify"), ("Models", "slipctl.models")):
        home = importlib.import_module(package)
        parts.append(f"## {title}\n\n{first_line(home)}\n")
        names = [f"{package}.{s}" for s in (*resolve.model_files(), "vehicle")]
        if title == "Bounds":
            papers = pkgutil.walk_packages(slipctl.models.__path__, "slipctl.models.")
            modules = (*pkgutil.walk_packages(home.__path__, f"{package}."), *papers)
            names = [m.name for m in modules if not m.ispkg and is_proof(m.name)]
        for name in sorted(n for n in names if ".__" not in n):
            found = importlib.import_module(name)
            parts.append(f"### {name}\n\n{prose(inspect.getdoc(found) or '')}\n")
            parts += [entry(k, v, 4) for k, v in own(found)]
    return "\n".join(parts)


def is_proof(module: str) -> bool:
    """Whether a module is of certify, or stands beside the law of a paper and proves it."""
    return ".certify." in module or (".certificate." in module and ".vehicle." not in module)


def first_line(module: ModuleType) -> str:
    """First paragraph of a module's docstring."""
    return (inspect.getdoc(module) or "").partition("\n\n")[0]


def own(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Public functions and blocks that a module defines, in its order."""
    for name, value in vars(module).items():
        if name.startswith("_"):
            continue
        is_block = isinstance(value, slipctl.Block)
        if is_block or (
            inspect.isfunction(inspect.unwrap(value)) and value.__module__ == module.__name__
        ):
            yield name, value


def entry(name: str, value: Any, level: int) -> str:
    """Heading, signature and docstring of one name."""
    head = "#" * level
    if isinstance(value, slipctl.Block):
        return block_entry(name, value, head)
    doc = prose(inspect.getdoc(value) or "")
    text = f"{head} {name}\n\n```python\n{signature(name, value)}\n```\n\n{doc}\n"
    if inspect.isclass(value):
        text += "".join(members(value))
    if getattr(value, "__module__", "").startswith("slipctl.models"):
        text += made_by(value)
    return text


def made_by(function: Any) -> str:
    """Table of the block that a function makes when called without arguments."""
    parameters = inspect.signature(function).parameters.values()
    if any(p.default is p.empty for p in parameters):
        return ""
    block = function()
    if not isinstance(block, slipctl.Block) or block.parts:
        return ""
    return f"\nWith its defaults it makes a `{block.kind}` block:\n\n{signals(block)}"


def block_entry(name: str, block: slipctl.Block, head: str) -> str:
    """Heading, meaning and signals of a block."""
    return f"{head} {name}\n\n`{block.kind}` block.\n\n{prose(block.doc)}\n\n{signals(block)}"


def signals(block: slipctl.Block) -> str:
    """Table of the signals of a block."""
    text = "| role | name | unit | value | meaning | source |\n|---|---|---|---|---|---|\n"
    for s in block.signals:
        value = "" if s.value is None else str(s.value)
        cells = (s.role, f"`{s.name}`", s.unit, value, s.doc, s.source)
        text += "| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |\n"
    return text


class Raw(str):
    """An annotation as it stands in the source, without quotes around it."""

    def __repr__(self) -> str:
        return str(self)


def short(annotation: Any) -> Any:
    """Annotation as it stands in the source."""
    if annotation is inspect.Signature.empty:
        return annotation
    text = annotation.__name__ if isinstance(annotation, type) else str(annotation)
    return Raw(re.sub(r"\b(?:[a-z_]+\.)+(?=[A-Z])", "", text))


def signature(name: str, value: Any) -> str:
    """Signature on one line if it fits, else one argument per line."""
    try:
        found = inspect.signature(value)
    except (TypeError, ValueError):
        return name
    if inspect.isclass(value):
        found = found.replace(return_annotation=inspect.Signature.empty)
    parameters = []
    for p in found.parameters.values():
        if p.name in ("self", "cls"):
            continue
        default = p.default
        if isinstance(default, slipctl.Block):
            default = Raw(default.name)
        elif inspect.isfunction(default):
            default = Raw("...")
        parameters.append(p.replace(annotation=short(p.annotation), default=default))
    found = found.replace(parameters=parameters, return_annotation=short(found.return_annotation))
    line = f"{name}{found}"
    if len(line) <= 96:
        return line
    stars, rows = False, []
    for p in parameters:
        if p.kind is p.KEYWORD_ONLY and not stars:
            rows.append("    *,")
        stars = stars or p.kind in (p.KEYWORD_ONLY, p.VAR_POSITIONAL)
        rows.append(f"    {p},")
    end = found.return_annotation
    tail = "" if end is found.empty else f" -> {end!r}"
    return "\n".join([f"{name}(", *rows, f"){tail}"])


def members(value: type) -> Iterator[str]:
    """Lines for the public methods and properties of a class that have a docstring."""
    fields = {f.name for f in dataclasses.fields(value)} if dataclasses.is_dataclass(value) else ()
    rows = []
    for name, member in vars(value).items():
        if (name.startswith("_") and name != "__call__") or name in fields:
            continue
        function = getattr(member, "func", getattr(member, "fget", member))
        if isinstance(member, (classmethod, staticmethod)):
            function = member.__func__
        doc = inspect.getdoc(function) if callable(function) else None
        if not doc:
            continue
        called = isinstance(member, property) or hasattr(member, "attrname")
        shown = name if called else signature(name, function)
        rows.append((f"`{shown}`" if "\n" not in shown else f"`{name}(...)`", doc))
    for shown, doc in rows:
        yield f"\n- {shown}: " + " ".join(prose(doc.partition("\n\n")[0]).split())
    yield "\n" if rows else ""


def prose(doc: str) -> str:
    """Docstring in Google style as markdown: sections become bold words, arguments lists."""
    out: list[str] = []
    section = ""
    for line in doc.splitlines():
        found = SECTION.match(line)
        if found:
            out += ["", f"**{found[1]}.** {found[2]}".rstrip()]
            out += [] if found[2] else [""]
            section = "" if found[2] else found[1]
            continue
        if line and not line.startswith(" "):
            section = ""
        item = re.match(r"^ {4}(?! )(.*)$", line)
        if not section or section in ("Returns", "Yields"):
            out.append(line.strip() if section else line.rstrip())
        elif item:
            name, colon, rest = item[1].partition(": ")
            known = colon and re.fullmatch(r"\**\w+(, \w+)*", name)
            out.append(f"- `{name}`: {rest}" if known else f"- {item[1]}")
        else:
            out.append(f"  {line.strip()}".rstrip())
    text = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", "\n".join(out))
    return re.sub(r"``([^`]+)``", r"`\1`", re.sub(r"\n{3,}", "\n\n", text)).strip()


if __name__ == "__main__":
    sys.exit(made(PAGE, page()))
