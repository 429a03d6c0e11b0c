"""Names at the door: studies and models by name, blocks by ``study:loop`` or ``file.py:block``.

What there is, is read from the source files without importing them.
"""

from __future__ import annotations

import ast
import importlib.util
import inspect
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import TYPE_CHECKING, Any

from slipctl import registry
from slipctl.block.portable import FILE
from slipctl.errors import BadInput, check_known, nearest
from slipctl.study.failures import blame, short
from slipctl.study.files import equation_files, trip_files

if TYPE_CHECKING:
    from slipctl.block.block import Block
    from slipctl.run.results import Case
    from slipctl.study.declaration import Study


def _sources(package: str) -> Iterator[tuple[str, Path, int]]:
    """Name, file and time of its last change, of each study or model."""
    if package == "studies":
        found = {path.parent.name: path for path in registry.folder(package).glob("*/study.py")}
    else:
        found = model_files()
    for name in sorted(n for n in found if not n.startswith("_")):
        yield name, found[name], found[name].stat().st_mtime_ns


def model_files() -> dict[str, Path]:
    """File of each model by its name, whatever folder of ``models`` it is in; no certificates."""
    here = registry.folder("models")
    papers = [path for path in here.glob("*/*.py") if path.parent.name != "vehicle"]
    files = (*here.glob("*.py"), *papers)
    return {path.stem: path for path in files if not path.stem.endswith("_kind")}


@lru_cache(maxsize=256)  # of a file as it is: many studies and models are looked up in a run
def _text(path: Path, changed: int) -> str:
    return path.read_text(encoding="utf-8")


@lru_cache(maxsize=256)
def _parsed(path: Path, changed: int) -> ast.Module:
    """What a file holds; nothing where it is no Python."""
    try:
        return ast.parse(_text(path, changed))
    except SyntaxError:
        return ast.parse("")


def _first_line(node: ast.Module | ast.FunctionDef) -> str:
    return (ast.get_docstring(node) or "").partition("\n")[0]


def studies() -> dict[str, str]:
    """First line of each study by name, read without importing it."""
    trees = {name: _parsed(path, changed) for name, path, changed in _sources("studies")}
    return {name: _first_line(tree) for name, tree in trees.items() if _assigns(tree)}


def _assigns(tree: ast.Module) -> bool:
    targets = [t for n in tree.body if isinstance(n, ast.Assign) for t in n.targets]
    targets += [n.target for n in tree.body if isinstance(n, ast.AnnAssign)]
    return not tree.body or any(isinstance(t, ast.Name) and t.id == "study" for t in targets)


def models() -> dict[str, tuple[str, dict[str, str]]]:
    """First line of each model module, and of each block in it, read without importing it."""
    return {name: _described(path, changed) for name, path, changed in _sources("models")}


@lru_cache(maxsize=256)
def _described(path: Path, changed: int) -> tuple[str, dict[str, str]]:
    """First line of a model module, and of each block in it."""
    tree = _parsed(path, changed)
    blocks = {
        f.name: _first_line(f)
        for f in tree.body
        if isinstance(f, ast.FunctionDef) and not f.name.startswith("_") and _makes_block(f)
    }
    return _first_line(tree), blocks


def _makes_block(f: ast.FunctionDef) -> bool:
    if isinstance(f.returns, ast.Name) and f.returns.id == "Block":
        return True
    calls = [d.func if isinstance(d, ast.Call) else d for d in f.decorator_list]
    return any(isinstance(c, ast.Name) and c.id in ("law", "flow", "step") for c in calls)


# ---- loading ------------------------------------------------------------------------------------


class _AsWritten(SourceFileLoader):
    """Reads a file as it is written now: no bytecode, which may be older, and none is left."""

    def get_code(self, fullname: str) -> CodeType:
        data = self.get_data(self.path)
        try:
            importlib.util.decode_source(data)
        except UnicodeDecodeError as error:  # else the compiler says it, in several manners
            line = data[: error.start].count(b"\n") + 1
            raise BadInput(
                f"{short(self.path)}, line {line}: the byte {data[error.start]:#04x} is no"
                f" {error.encoding} text; save the file in UTF-8"
            ) from error
        return self.source_to_code(data, self.path)


ONLY: list[frozenset[Path]] = []
"""Python files that alone may be imported, where that was said; empty where any may be."""


def load_only(files: Sequence[str]) -> None:
    """Let no other Python files be imported from now on: a page's text must not name new code."""
    ONLY[:] = [frozenset(Path(f).resolve() for f in files)]


def load_file(path: str) -> ModuleType:
    """Import a Python file of the user.

    Raises:
        BadInput: no such file, it cannot be run, or it may not be; says the line.
    """
    place = Path(path)
    if not place.is_file():
        raise BadInput(f"there is no file {path}")
    if ONLY and place.resolve() not in ONLY[0]:
        raise BadInput(f"{path} is Python and was not named at the start; write slipctl open FILE"
                       f" --python {path}")  # fmt: skip
    as_it_is = place.stat()  # it may be edited while Python runs
    key = (str(place.resolve()), as_it_is.st_mtime_ns, as_it_is.st_size)
    name = f"{FILE}{abs(hash(key))}_{place.stem}"
    if name in sys.modules:
        return sys.modules[name]
    if place.suffix != ".py":
        raise BadInput(f"{path} is no Python file; it must end in .py")
    spec = importlib.util.spec_from_file_location(name, place, loader=_AsWritten(name, str(place)))
    assert spec is not None
    assert spec.loader is not None  # the one given
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    beside = str(place.resolve().parent)
    if beside not in sys.path:
        sys.path.append(beside)
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, SyntaxError) and not error.filename:  # no text at all
            raise BadInput(f"{path} is no Python file: {error.msg}") from error
        if isinstance(error, (MemoryError, RecursionError)):
            raise BadInput(f"{path} is nested too deeply to be read") from error
        if not isinstance(error, KeyboardInterrupt):
            blame(error)
        raise
    return module


def _import(package: str, name: str) -> ModuleType:
    try:
        return registry.module(package, name)
    except Exception as error:
        blame(error)


def load_study(name: str) -> Study:
    """Study by its name, the one in a file ``my_study.py``, or a vehicle in ``my.toml``.

    Raises:
        BadInput: no such study.
    """
    from slipctl.study.declaration import Study

    if name.endswith(".toml"):
        if not Path(name).is_file():
            raise BadInput(f"there is no file {name}; slipctl new metro {name} writes one")
        return trip_files.load(name)
    if name.endswith(".py"):
        module = load_file(name)
    else:
        known = studies()
        if name not in known:
            raise BadInput(f"there is no study {name!r}{_meant(name, known, 'slipctl list')}")
        module = _import("studies", name)
    study = getattr(module, "study", None)
    if not isinstance(study, Study):
        raise BadInput(f"{name} has no study; it must end in: study = Study(...)")
    return study


def has_study(path: str) -> bool:
    """Whether a file defines a study, so that ``file.py:loop`` is a loop of it."""
    return hasattr(load_file(path), "study")


def _meant(name: str, known: Any, command: str) -> str:
    said = nearest(name, known)
    return (
        said
        if said.startswith("; did you")
        else f"{said.replace('it has', 'there are')}; see {command}"
    )


def is_written(name: str) -> bool:
    """Whether a name is a block written as text: an equation, or a table of a TOML file."""
    from slipctl.block.text.meanings import is_equation

    file = name.rpartition(":")[0] or name
    return is_equation(name) or (equation_files.is_file(file) and not trip_files.is_trip(file))


def load_written(name: str) -> Block:
    """Block of an equation, ``"mu = c*v_s where ..."``, or by ``file.toml:table``.

    Raises:
        BadInput: what is wrong with it.
    """
    from slipctl.block.text.equations import from_text
    from slipctl.block.text.meanings import is_equation

    return from_text(name) if is_equation(name) else equation_files.load(name)


def load_block(name: str) -> Block:
    """Block by ``study:loop[@scenario]``, ``model``, ``module.model``, ``file.py:block`` or text.

    ``study:loop.part`` is a part of the loop, with the numbers and the start that it has there.
    A text is an equation, ``"mu = c*v_s where ..."``, or a table of a file, ``file.toml:table``.

    Raises:
        BadInput: no such thing, with the nearest name; a function that needs arguments.
    """
    if is_written(name):
        return load_written(name)
    if "=" in name and ".py" not in name:
        raise BadInput(
            f"{name[:60]!r} is no equation; write name = expression where x [unit], p = value"
        )
    left, colon, right = name.rpartition(":")
    if colon and left.endswith(".py") and not has_study(left):
        return find_block(load_file(left), right, left)
    if colon:
        from slipctl.run.logs.replay import part_of

        loop, dot, path = right.partition(".")
        found = find_loop(load_study(left), loop)[0]
        return part_of(found, path) if dot else found
    if name.endswith((".py", ".toml")):
        raise BadInput(f"{name}: write which block of it, {name}:block")
    return _model(name)


@lru_cache(maxsize=256)
def _model(name: str) -> Block:
    """Block by ``model`` or ``module.model``: a model is imported once, and so it is made once."""
    if "." not in name:
        mentioned = (s for s in _sources("models") if f"def {name}(" in _text(*s[1:]))
        hits = [module for module, *file in mentioned if name in _described(*file)[1]]
        if len(hits) == 1:
            return find_block(_import("models", hits[0]), name, hits[0])
        if hits:
            where = " or ".join(f"{m}.{name}" for m in hits)
            raise BadInput(f"{name!r} could be {where}; write which")
    known = models()
    if "." in name:
        module, _, block = name.rpartition(".")
        check_known("there is no model file", module, known)
        return find_block(_import("models", module), block, module)
    if name in known:
        raise BadInput(f"{name} is a file of models; write which: " + ", ".join(
            f"{name}.{b}" for b in known[name][1]))  # fmt: skip
    names = [*studies(), *(b for _, blocks in known.values() for b in blocks)]
    raise BadInput(f"there is no model or study {name!r}{_meant(name, names, 'slipctl list')}")


def find_block(module: ModuleType, name: str, where: str) -> Block:
    """Block ``name`` of a module; a function that makes one is called without arguments.

    Raises:
        BadInput: no such block, or a function that needs arguments.
    """
    from slipctl.block.block import Block

    found: Any = getattr(module, name, None)
    own = [
        k
        for k, v in vars(module).items()
        if not k.startswith("_")
        and (isinstance(v, Block)
             or (callable(v) and getattr(v, "__module__", "") == module.__name__))
    ]  # fmt: skip
    if found is None:
        raise BadInput(f"{where} has no block {name!r}{nearest(name, own)}")
    if isinstance(found, Block):
        return found
    if not callable(found):
        raise BadInput(f"{where}:{name} is no block; decorate it with @law, @flow or @step")
    try:
        signature = inspect.signature(found)
    except (TypeError, ValueError) as error:
        raise BadInput(f"{where}:{name} has arguments that cannot be read: {error}") from None
    needed = [
        p.name
        for p in signature.parameters.values()
        if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    if needed:
        raise BadInput(
            f"{where}.{name} is a function that needs {', '.join(needed)}; write a file with"
            f" block = {name}({needed[0]}=...) and name it file.py:block"
        )
    try:
        block = found()
    except Exception as error:
        blame(error)
    if not isinstance(block, Block):
        raise BadInput(f"{where}:{name} is no block; decorate it with @law, @flow or @step")
    return block


def build_cases(
    study: Study, quick: bool = False, models: Mapping[str, Any] | None = None
) -> list[Case]:
    """Cases of a study, of its own models or of others.

    Raises:
        BadInput: they cannot be built.
    """
    try:
        return list(study.cases(study.models if models is None else models, quick))
    except Exception as error:
        blame(error)


def find_loop(study: Study, name: str, quick: bool = False) -> tuple[Block, Case]:
    """Loop of a study by ``loop`` or ``loop@scenario``, and the first case that has it.

    Raises:
        BadInput: no such loop or scenario.
    """
    return pick_loop(study, build_cases(study, quick), name)


def pick_loop(study: Study, cases: Sequence[Case], name: str) -> tuple[Block, Case]:
    """Find a loop as ``find_loop`` does, in cases that are built already.

    Raises:
        BadInput: no such loop or scenario.
    """
    loop, at, scenario = name.partition("@")
    if at and scenario not in [c.scenario.name for c in cases]:
        known = [c.scenario.name for c in cases]
        raise BadInput(f"{study.name} has no scenario {scenario!r}{nearest(scenario, known)}")
    for case in cases:
        if loop in case.loops and scenario in ("", case.scenario.name):
            return case.loops[loop], case
    names = dict.fromkeys(n for c in cases if scenario in ("", c.scenario.name) for n in c.loops)
    raise BadInput(f"{study.name} has no loop {loop!r}{nearest(loop, names)}")


def loop_names(study: Study) -> list[str]:
    """Names of the loops of a study."""
    return list(dict.fromkeys(n for case in build_cases(study) for n in case.loops))


def model_source(name: str) -> tuple[str, str, str]:
    """Module, block to try, and source text of a model, by module, block or ``module.block``.

    Imports of neighbours are written in full, so that the text runs from any folder.

    Raises:
        BadInput: no such model.
    """
    known = models()
    module, _, block = name.rpartition(".") if "." in name else ("", "", name)
    if not module and block in known:
        module, block = block, next(iter(known[block][1]), "block")
    elif not module:
        module = next((m for m, (_, blocks) in known.items() if block in blocks), "")
    if module not in known or block not in (*known[module][1], "block"):
        names = [*known, *(b for _, blocks in known.values() for b in blocks)]
        raise BadInput(f"there is no model {name!r}{_meant(name, names, 'slipctl list')}")
    home = registry.package_name("models")
    text = model_files()[module].read_text(encoding="utf-8")
    text = re.sub(r"(?m)^(\s*from )\.(?=\w)", rf"\1{home}.", text)
    return module, block, re.sub(r"(?m)^(\s*from )\.(?= import)", rf"\1{home}", text)
