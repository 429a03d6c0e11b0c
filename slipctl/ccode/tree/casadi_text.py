"""CasADi's C text, cleaned: what the equations need of it, static, without its exported interface.

CasADi generates one file with exported functions around the algorithm. Kept are the functions and
tables that are reached; SX Functions among them are written anew. What cannot be generated, needs a
library, allocates memory or keeps global data is refused.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from slipctl.ccode.module.comments import comment
from slipctl.ccode.passes.direct_results import direct
from slipctl.ccode.tree.expressions import Unsupported, Writer
from slipctl.ccode.tree.helpers import HELPERS
from slipctl.errors import BadInput

_INSTEAD = {
    "Newton": "use rootfinder(..., 'fast_newton', ...)",
    "KinsolInterface": "use rootfinder(..., 'fast_newton', ...)",
    "ImplicitToNlp": "use rootfinder(..., 'fast_newton', ...)",
    "RungeKutta": "use integrator(..., 'rk', ..., {'simplify': True})",
    "Collocation": "use integrator(..., 'rk', ..., {'simplify': True})",
    "CvodesInterface": "use integrator(..., 'rk', ..., {'simplify': True})",
    "IdasInterface": "use integrator(..., 'rk', ..., {'simplify': True})",
    "CallbackInternal": "write it in CasADi operations",
}
"""What to write instead of what CasADi cannot generate, by the name it gives."""

_LIBRARY = {"math.h", "stdio.h", "stdarg.h"}  # the last two: printing that is compiled out


def signature(f: ca.Function) -> str:
    """Name, arguments and results, as the comment before the C function has them."""
    return str(f).rpartition(" ")[0]


def casadi_c(functions: Sequence[ca.Function], where: str) -> str:
    """C text as CasADi gives it.

    Raises:
        BadInput: an operation that CasADi cannot generate, by name.
    """
    options: dict[str, Any] = {"static_aux": True, "casadi_int": "int", "with_header": False}
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        try:
            generator = ca.CodeGenerator("kernel.c", options)
            for f in functions:
                generator.add(f)
            text = str(generator.dump())
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1]
            raise BadInput(f"{where}: CasADi cannot generate C for it: {reason}") from None
    refused = re.search(r"#error\s+(.*)", text)
    if refused:
        what = refused[1].removeprefix("Code generation not supported for").strip()
        named = re.search(r'The function "(\w+)", which is of type', said.getvalue())
        of = f" {named[1]!r}" if named else ""
        instead = _INSTEAD.get(what, "write it in other operations, or compute it outside")
        raise BadInput(f"{where}: CasADi cannot generate C for {what}{of}; {instead}")
    text = re.sub(r"\bCASADI_PREFIX\((\w+)\)", r"casadi_\1", text)
    # an argument is NULL only where it has no numbers; the table of zeros would be constant data
    return re.sub(r"\b(arg\[\d+\])\s*\? \1 : casadi_zeros\b", r"\1", text)


_OWN = {
    "casadi_fmin": "lesser",
    "casadi_fmax": "greater",
    "casadi_sq": "square",
    "casadi_sign": "sign_of",
    "casadi_fabs": "fabs",
}
"""CasADi's helpers that we write ourselves, inlined."""


@dataclass(frozen=True)
class StaticText:
    """CasADi's text of some Functions, cleaned."""

    text: str
    entries: list[str]
    work: tuple[int, int, int, int]
    helpers: frozenset[str]
    copied: bool


def static_text(
    functions: Sequence[ca.Function], docs: Mapping[str, str], where: str
) -> StaticText:
    """Text of Functions and of what they call.

    Args:
        functions: Functions of different names.
        docs: comment by name of a Function.
        where: name of the block, for errors.

    Raises:
        BadInput: as :func:`casadi_c`; a library, the heap or global data is needed.
    """
    text = casadi_c(functions, where)
    sizes: dict[str, int] = {}
    for name, size in re.findall(r"if \((sz_arg|sz_res|sz_iw|sz_w)\) \*\1 = (\d+);", text):
        sizes[name] = max(sizes.get(name, 0), int(size))
    chunks = [c for c in chunks_of(text) if not _boilerplate(c) and c.name not in _OWN]
    _refuse(text, chunks, where)
    _own_sx(chunks, functions, docs)
    wrappers = []
    for f in functions:
        wrapper = re.search(rf"\b{f.name()}\(const[^)]*\)\s*\{{\s*return (casadi_f\d+)\(", text)
        assert wrapper is not None
        wrappers.append(wrapper[1])
    kept = _reached(chunks, wrappers)
    names = {c.name: f"{c.label}__{c.name[7:]}" for c in kept if c.label}
    helpers: set[str] = set()
    for c in kept:
        helpers |= c.helpers
    body = "\n\n".join(_clean(direct(c.text) if c.label else c.text) for c in kept)
    helpers |= {own for old, own in _OWN.items() if re.search(rf"\b{old}\b", body)} & set(HELPERS)
    for old, new in (names | _OWN).items():
        body = re.sub(rf"\b{old}\b", new, body)
    return StaticText(
        body, [names.get(w, w) for w in wrappers],
        (sizes["sz_arg"], sizes["sz_res"], sizes["sz_iw"], sizes["sz_w"]), frozenset(helpers),
        any(not c.label and c.name.startswith("casadi_") for c in kept),
    )  # fmt: skip


@dataclass
class _Chunk:
    """One definition at file level."""

    text: str
    name: str = ""  # what it defines
    label: str = ""  # name of the Function it evaluates
    signature: str = ""
    helpers: frozenset[str] = frozenset()


def chunks_of(text: str) -> list[_Chunk]:
    """Split C text into its definitions at file level."""
    found: list[_Chunk] = []
    lines: list[str] = []
    depth = conditions = 0
    for line in text.splitlines():
        bare = line.strip()
        if not depth and re.match(r"#\s*(if|endif)", bare):
            conditions += -1 if re.match(r"#\s*endif", bare) else 1
        lines.append(line)
        if not bare.startswith(("#", "/*", "*")):
            depth += line.count("{") - line.count("}")
        directive = bare.startswith("#") and not bare.endswith("\\")
        if depth or conditions or not (directive or bare.endswith(("}", "};", ";")) or not bare):
            continue
        if "".join(lines).strip():
            found.append(_named("\n".join(lines).strip("\n")))
        lines = []
    return found


def _named(text: str) -> _Chunk:
    code = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL).strip()
    first = code.partition("{")[0]
    patterns = (
        r"#define (\w+)", r"struct (\w+)\s*$", r"(\w+)\s*(?:\[[^\]]*\])?\s*=", r"(\w+)\s*\(",
    )  # fmt: skip
    name = next((m[1] for p in patterns if (m := re.search(p, first))), "")
    if code.startswith("typedef"):
        ended = re.search(r"(\w+)\s*;$", code)
        name = ended[1] if ended else name
    comment = re.match(r"\s*/\* (\w+):(\(.*\)->\(.*\)) \*/", text)
    if comment and re.fullmatch(r"casadi_f\d+", name):
        return _Chunk(text, name, comment[1], f"{comment[1]}:{comment[2]}")
    return _Chunk(text, name)


def _boilerplate(chunk: _Chunk) -> bool:
    """Whether it is a prefix macro, an option or an exported function."""
    text = re.sub(r"/\*.*?\*/", "", chunk.text, flags=re.DOTALL).strip()
    if not text or text.startswith(("#include", "#ifdef CASADI", "#ifndef casadi", "#ifndef CAS")):
        return True
    if re.match(r"#define (casadi_\w+) \1$", text):
        return True
    return not text.startswith(("static", "#define", "struct", "typedef", "enum"))


def _refuse(text: str, chunks: Iterable[_Chunk], where: str) -> None:
    for header in re.findall(r"#include [<\"]([^>\"]+)[>\"]", text):
        if header not in _LIBRARY:
            raise BadInput(
                f"{where}: its C would need the library of <{header}>; use a solver that CasADi"
                " writes out, such as 'qrqp' or 'fast_newton'"
            )
    for c in chunks:
        code = c.text.partition("{")[0]
        if code.startswith("static") and "(" not in code and "const" not in code:
            raise BadInput(
                f"{where}: its C would keep global data ({c.name}), as sqpmethod and external"
                " solvers do, and could not run twice; iterate with fold() or 'fast_newton'"
            )
    heap = re.search(r"\b(malloc|calloc|realloc)\s*\(", text)
    if heap:
        raise BadInput(f"{where}: its C would call {heap[1]}; use another solver")


def _own_sx(
    chunks: list[_Chunk], functions: Sequence[ca.Function], docs: Mapping[str, str]
) -> None:
    """Write nested SX Functions anew, where the name tells which one it is."""
    known: dict[str, list[ca.Function]] = {}
    for f in functions:
        for g in (f, *f.find_functions()):
            known.setdefault(signature(g), []).append(g)
    for c in chunks:
        candidates = known.get(c.signature, [])
        same = len({g.serialize() for g in candidates}) == 1
        if c.label and docs.get(c.label):
            c.text = re.sub(
                r"^\s*/\*.*?\*/", comment(f"{c.signature}: {docs[c.label]}").replace("\\", "/"),
                c.text, count=1, flags=re.DOTALL,
            )  # fmt: skip
        if not same or not candidates[0].is_a("SXFunction"):
            continue
        try:
            writer = Writer(candidates[0], lambda i, k: f"arg[{i}][{k}]").run()
        except Unsupported:
            continue
        c.text = _as_function(c, writer)
        c.helpers = frozenset(writer.helpers)


def _as_function(chunk: _Chunk, writer: Writer) -> str:
    comment = re.match(r"\s*/\*.*?\*/", chunk.text, flags=re.DOTALL)
    lines = [comment[0]] if comment else []
    arguments = "const double **arg, double **res, int *iw, double *w, int mem"
    lines += [f"static int {chunk.name}({arguments})", "{"]
    body = [f"    {line}" for line in writer.lines]
    at: dict[int, list[str]] = {}
    for (i, k), node in writer.results:
        at.setdefault(i, []).append(f"        res[{i}][{k}] = {writer.result(node)};")
    for i, assignments in at.items():
        body += [f"    if (res[{i}] != NULL) {{", *assignments, "    }"]
    return "\n".join([*lines, *body, "    return 0;", "}"])


def _reached(chunks: list[_Chunk], entries: Sequence[str]) -> list[_Chunk]:
    """Definitions that the entries need, in their order."""
    by_name: dict[str, list[_Chunk]] = {}
    for c in chunks:
        by_name.setdefault(c.name, []).append(c)
    wanted, waiting = set(), list(entries)
    while waiting:
        name = waiting.pop()
        if name in wanted or name not in by_name:
            continue
        wanted.add(name)
        for c in by_name[name]:
            waiting += re.findall(r"\w+", c.text)
    return [c for c in chunks if c.name in wanted]


_VALUE = r"(?:\(\*\w+\+\+\)|\*?\w+(?:\[\w+\])?)"
_REPLACED = (
    # a real number as a condition: compared, so that no compiler warns
    (rf"\(! ({_VALUE}|\*\w+\+\+) \)", r"(\1 == 0)"),
    (rf"\(({_VALUE})\?", r"(\1 != 0 ? "),
    (r"\bif \(bottom\)", "if (bottom != 0)"),  # B-splines
    (r"\*\(ng-1\)/", "*(double)(ng-1)/"),  # tables of even steps: a float does not hold any int
    (rf"\(({_VALUE})(&&|\|\|)({_VALUE})\)", r"(\1 != 0 \2 \3 != 0)"),
    (r"\bcasadi_real_min\b", "DBL_MIN"),
    (r"\bcasadi_real\b", "double"),
    (r"\bcasadi_int\b", "int"),
    (r"\bcasadi_nan\b", "((double)NAN)"),  # NAN itself is a float
    (r"\bcasadi_inf\b", "((double)INFINITY)"),
    (r"\barg\[(\d+)\]\s?\? arg\[\1\]\[(\d+)\] : 0", r"arg[\1][\2]"),  # never NULL here
    # pointers are compared with NULL, numbers with numbers, and a truth is chosen as a number
    (r"\b((?:arg|res)1?\[\d+\])=0;", r"\1=NULL;"),
    (r"\bif \(((?:arg|res)1?\[\d+\])\) ([^;{}]*;)", r"if (\1 != NULL) { \2 }"),
    (
        r"\bif \((\w+\(arg1?(?:\+\d+)?, res1?, iw, w, 0\))\) return 1;",
        r"if (\1 != 0) { return 1; }",
    ),
    (rf"({_VALUE}) != 0 \? ", r"\1 != 0.0 ? "),
    (rf"({_VALUE} != 0\.0 \? {_VALUE}):0\)", r"\1:0.0)"),
    (rf"({_VALUE}) (!=) 0 (&&|\|\|) ({_VALUE}) (!=) 0\)", r"\1 \2 0.0 \3 \4 \5 0.0)"),
    (rf"= \(({_VALUE}) == 0\);", r"= (\1 == 0.0);"),
    (rf"= \(({_VALUE} ?(?:==|!=|<=?) ?{_VALUE})\);", r"= (\1) ? 1.0 : 0.0;"),
    (rf"= \(({_VALUE} != 0\.0 (?:&&|\|\|) {_VALUE} != 0\.0)\);", r"= (\1) ? 1.0 : 0.0;"),
    (rf"= \(({_VALUE} == 0\.0)\);", r"= (\1) ? 1.0 : 0.0;"),
    (r"\b(wr?\d+)\+0\b", r"\1"),
    (r"(for \(i=0; i<\d+; \+\+i\)) ((?:arg|res)1\[i\]=(?:arg|res)\[i\];)", r"\1 { \2 }"),
    (r"(casadi_to_int\(x\)) \(\(\w+\) x\)", r"\1 ((int)(x))"),
    (r"\bif \(arg\[0\] \? (casadi_to_int\(\*arg\[0\]\)) : 0\)", r"if (\1 != 0)"),
    (r"\b(double r = (?:is_dense \? \S+ : )?)0;", r"\g<1>0.0;"),
    (r"(for \(i=0; i<n; \+\+i\)) (r = \w+\(r, x\[i\]\);)", r"\1 { \2 }"),
    (r"\b0\+ ?i\*\d+", "0"),  # address of nothing: repmat of an empty vector
    (
        r"(?s)/\* Pre-c99 compatibility \*/\n#if __STDC_VERSION__ < 199901L\n.*?#else\n"
        r"(.*?)#endif\n",
        r"\1",
    ),
)
"""CasADi's types and macros, and what they mean."""


def _clean(text: str) -> str:
    for pattern, meaning in _REPLACED:
        text = re.sub(pattern, meaning, text)
    return _quiet(text)


def _quiet(text: str) -> str:
    """Mark arguments that a function does not use."""
    head, _, body = text.partition("{")
    signature = re.sub(r"/\*.*?\*/", "", head, flags=re.DOTALL).strip()
    parameters = re.fullmatch(r"static [^=()]*\(([^()]*)\)", signature)
    if not parameters:
        return text
    names = [re.search(r"(\w+)\s*$", p) for p in parameters[1].split(",")]
    unused = [m[1] for m in names if m and m[1] != "void" and not re.search(rf"\b{m[1]}\b", body)]
    if not unused:
        return text
    voids = " ".join(f"(void){n};" for n in unused)
    # declarations come first in CasADi's text; C99 allows a statement before them
    return f"{head}{{\n  {voids}{body}"
