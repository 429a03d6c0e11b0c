"""CasADi's C, cleaned: what the equations need of it, static, without its exported interface.

CasADi generates one file with exported functions around the algorithm. It is read once, as nodes.
Kept are the functions and tables that are reached; SX Functions among them are written anew. What
cannot be generated, needs a library, allocates memory or keeps global data is refused.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from slipctl.ccode.module.comments import comment
from slipctl.ccode.tree import nodes as c
from slipctl.ccode.tree.expressions import Unsupported, Writer, constant
from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code, expression
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


def casadi_c(functions: Sequence[ca.Function], where: str) -> list[Node]:
    """C as CasADi gives it: definitions at file level.

    Raises:
        BadInput: an operation that CasADi cannot generate, by name; a library, the heap or global
            data would be needed.
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
    _, refused, rest = text.partition("#error")
    if refused:
        what = rest.splitlines()[0].strip()
        what = what.removeprefix("Code generation not supported for").strip()
        named = re.search(r'The function "(\w+)", which is of type', said.getvalue())
        of = f" {named[1]!r}" if named else ""
        instead = _INSTEAD.get(what, "write it in other operations, or compute it outside")
        raise BadInput(f"{where}: CasADi cannot generate C for {what}{of}; {instead}")
    try:
        found = code(_decided(text), _TYPES)
    except ValueError as error:
        raise BadInput(
            f"{where}: the C that CasADi generates for it is not known: {error}"
        ) from None
    _refuse(found, where)
    return found


def _decided(text: str) -> str:
    """Text without the lines of CasADi's prefixes, and of the others of its conditions one side.

    That is the one behind #else, so of C99, and nothing is printed.
    """
    lines: list[str] = []
    taken = [True]
    text = re.sub(r"\bCASADI_PREFIX\((\w+)\)", r"casadi_\1", text)
    text = re.sub(r"\bCASADI_CAST\(casadi_real, ([^()]+)\)", r"\1", text)  # of numbers already
    for line in text.replace("CASADI_SYMBOL_EXPORT ", "").splitlines():
        word = line.replace("#", " ").split()[:1] if line.lstrip().startswith("#") else [""]
        if word[0].startswith("if"):
            taken.append(False)
        elif word[0] == "else":
            taken[-1] = True
        elif word[0] == "endif":
            taken.pop()
        elif all(taken) and not line.startswith("#define"):
            lines.append(line)
    return "\n".join(lines)


_TYPES = {"casadi_real": "double", "casadi_int": "int", "casadi_qrqp_flag_t": "casadi_qrqp_flag_t"}
"""CasADi's types, and what they are."""

_OWN = {
    "casadi_fmin": "lesser", "casadi_fmax": "greater", "casadi_sq": "square",
    "casadi_sign": "sign_of", "casadi_fabs": "fabs",
}  # fmt: skip
"""CasADi's helpers that we write ourselves, inlined."""


@dataclass(frozen=True)
class StaticC:
    """CasADi's C of some Functions, cleaned."""

    made: tuple[Node, ...] = ()
    entries: tuple[str, ...] = ()
    work: tuple[int, int, int, int] = (0, 0, 0, 0)
    copied: bool = False


def static_c(functions: Sequence[ca.Function], docs: Mapping[str, str], where: str) -> StaticC:
    """C of Functions and of what they call.

    Args:
        functions: Functions of different names.
        docs: comment by name of a Function.
        where: name of the block, for errors.

    Raises:
        BadInput: as :func:`casadi_c`.
    """
    whole = casadi_c(functions, where)
    defined = {name: n for n in whole if (name := _defined(n)) and name not in _OWN}
    signatures = {name: n.told[3:-3] for name, n in defined.items() if _is_function(name)}
    writers = _own_sx(signatures, functions)
    for name, told in signatures.items():
        label = told.partition(":")[0]
        n = defined[name]
        body = _own_body(writers[name]) if name in writers else _clean(n.parts[1])
        said = comment(f"{told}: {docs[label]}") if docs.get(label) else f"/* {told} */"
        defined[name] = c.function(n.head, name, n.parts[0].parts, _quiet(n.parts[0], body), said)
    wrappers = [_wrapped(whole, f) for f in functions]
    kept = _reached(defined, wrappers)
    new = {name: f"{signatures[name].partition(':')[0]}__{name[7:]}" for name in kept
           if name in signatures}  # fmt: skip
    own = [defined[name] if name in new else _runtime(defined[name]) for name in kept]
    made = tuple(c.with_calls(n, new | _OWN) for n in own)
    sizes = [max(_sizes(whole, f"sz_{k}"), default=0) for k in ("arg", "res", "iw", "w")]
    return StaticC(
        made, tuple(new.get(w, w) for w in wrappers), (sizes[0], sizes[1], sizes[2], sizes[3]),
        len(new) < len(kept),
    )  # fmt: skip


def _defined(n: Node) -> str:
    """What a node at file level defines, if it is none of the exported functions."""
    if n.kind == "function":
        return n.parts[0].head if n.head.startswith("static") else ""
    if n.kind == "declare" and n.head.startswith("static"):
        to = c.target(n)
        return (to if to is not None else n.parts[0]).base.head
    if n.kind == "struct":
        return n.head.split()[-1]
    return n.told if n.kind == "text" else ""


def _is_function(name: str) -> bool:
    """Whether CasADi has written it for a Function."""
    return name.startswith("casadi_f") and name.removeprefix("casadi_f").isdecimal()


def _wrapped(whole: Iterable[Node], f: ca.Function) -> str:
    """Name of the C function that the exported one of a Function calls."""
    (found,) = (n for n in whole if n.kind == "function" and n.parts[0].head == f.name())
    return next(x.head for x in found.walk() if x.kind == "call" and _is_function(x.head))


def _sizes(whole: Iterable[Node], name: str) -> list[int]:
    """Sizes of work that CasADi gives by an address."""
    by = c.value_at(c.name(name))
    return [
        int(c.value(s).head) for n in whole if n.kind == "function" for s in n.walk()
        if s.kind == "do" and c.target(s) == by and c.value(s).kind == "number"
    ]  # fmt: skip


def _refuse(whole: Iterable[Node], where: str) -> None:
    for n in whole:
        header = n.head.partition("<")[2].rstrip(">") if n.head.startswith("#include") else ""
        if header and header not in _LIBRARY:
            raise BadInput(
                f"{where}: its C would need the library of <{header}>; use a solver that CasADi"
                " writes out, such as 'qrqp' or 'fast_newton'"
            )
        kept = n.kind == "declare" and n.head.startswith("static") and "const" not in n.head
        if kept and n.parts[0].kind != "call":
            raise BadInput(
                f"{where}: its C would keep global data ({_defined(n)}), as sqpmethod and external"
                " solvers do, and could not run twice; iterate with fold() or 'fast_newton'"
            )
        heap = n.calls() & {"malloc", "calloc", "realloc"}
        if heap:
            raise BadInput(f"{where}: its C would call {min(heap)}; use another solver")


def _own_sx(signatures: Mapping[str, str], functions: Sequence[ca.Function]) -> dict[str, Writer]:
    """Nested SX Functions written anew, where the name tells which one it is."""
    known: dict[str, list[ca.Function]] = {}
    for f in functions:
        for g in (f, *f.find_functions()):
            known.setdefault(str(g).rpartition(" ")[0], []).append(g)
    found = {}
    for name, told in signatures.items():
        candidates = known.get(told, [])
        same = len({g.serialize() for g in candidates}) == 1
        if same and candidates[0].is_a("SXFunction"):
            with contextlib.suppress(Unsupported):
                found[name] = Writer(candidates[0], lambda i, k: expression(f"arg[{i}][{k}]")).run()
    return found


def _own_body(writer: Writer) -> Node:
    at: dict[int, list[Node]] = {}
    for (i, k), node in writer.results:
        given = c.assign(expression(f"res[{i}][{k}]"), writer.result(node))
        at.setdefault(i, []).append(given)
    ifs = [c.branch(expression(f"res[{i}] != NULL"), given) for i, given in at.items()]
    return c.block([*writer.lines, *ifs, c.give(c.ZERO)])


def _reached(defined: Mapping[str, Node], entries: Sequence[str]) -> list[str]:
    """Definitions that the entries need, in their order."""
    wanted, waiting = set[str](), list(entries)
    while waiting:
        name = waiting.pop()
        if name in defined and name not in wanted:
            wanted.add(name)
            n = defined[name]
            waiting += n.words
            waiting += [w for x in n.walk() for w in x.head.split() if x.kind == "declare"]
            waiting += n.head.replace("(", " ").split() if n.kind == "text" else []
    return [name for name in defined if name in wanted]


# ---- CasADi's habits, in C that no compiler warns of --------------------------------------------

_NUMBERS = {"casadi_real_min": "DBL_MIN", "casadi_nan": "((double)NAN)",
            "casadi_inf": "((double)INFINITY)"}  # fmt: skip
_NO_REAL = constant(0.0)


def _meaning(n: Node) -> Node | None:
    """What one of CasADi's macros is."""
    if n.kind == "call" and n.head == "casadi_to_int":
        return Node("cast", "int", (c.paren(n.parts[0].change(_meaning)),))
    return expression(_NUMBERS[n.head]) if n.kind == "name" and n.head in _NUMBERS else None


def _runtime(n: Node) -> Node:
    """A function of CasADi's library: numbers are no conditions, integers are turned to them."""

    def rule(x: Node) -> Node | None:
        if x.kind == "if" and x.parts[0] == c.name("bottom"):  # B-splines
            asked = c.op(x.parts[0], "!=", _NO_REAL)
            return replace(x, parts=(asked, *(p.change(rule) for p in x.parts[1:])))
        if x == _EVEN:  # tables of even steps: a float does not hold any int
            return Node("cast", "double", (x,))
        if x.kind == "declare" and x.head == "double" and (to := c.target(x)) is not None:
            if to == c.name("r") and c.value(x) == c.ZERO:
                return c.declare("double", "r", _NO_REAL)
            if to == c.name("r") and c.value(x).kind == "choice":
                asked, yes, no = c.value(x).parts
                return c.declare("double", "r", Node("choice", "", (
                    asked, yes.change(_meaning), _NO_REAL if no == c.ZERO else no)))  # fmt: skip
        return _meaning(x)

    return n.change(rule)


_EVEN = expression("(ng - 1)")


def _is_value(n: Node) -> bool:
    """Whether it is a real number at hand: a local, an element, what an address holds."""
    if n.kind == "paren":
        return _is_value(n.parts[0])
    if n.kind == "index":
        return n.parts[0].kind == "name" and not n.parts[0].head.startswith(("arg", "res"))
    local = n.kind == "name" and n.head[:1] == "w" and n.head[1:].isdecimal()
    return local or (n.kind == "unary" and n.head == "*")


def _is_truth(n: Node) -> bool:
    inside = n.parts[0] if n.kind == "paren" else n
    return (inside.kind == "op" and inside.head in ("==", "!=", "<", "<=", "&&", "||")) or (
        inside.kind == "unary" and inside.head == "!"
    )


def _clean(body: Node) -> Node:
    """A Function's C: reals are compared with 0.0, pointers with NULL, a truth is a number."""

    def real(n: Node) -> Node:
        made = n.change(rule)
        return made if not _is_value(n) else c.op(made, "!=", _NO_REAL)

    def rule(n: Node) -> Node | None:
        if n.kind == "choice":
            asked, yes, no = n.parts
            if asked.kind == "index" and asked.parts[0].head == "arg":
                return yes.change(rule)  # never NULL here
            if _is_value(asked):
                other = _NO_REAL if no == c.ZERO else no.change(rule)
                return Node("choice", "", (real(asked), yes.change(rule), other))
        if n.kind == "unary" and n.head == "!" and _is_value(n.parts[0]):
            return c.op(n.parts[0].change(rule), "==", _NO_REAL)
        if n.kind == "op" and n.head in ("&&", "||"):
            return c.op(real(n.parts[0]), n.head, real(n.parts[1]))
        if n.kind == "op" and n.head == "=":
            return _given(n, rule)
        if n.kind == "op" and n.head == "+" and c.ZERO in n.parts:
            whole = n.parts[1] if n.parts[0] == c.ZERO else n.parts[0]
            nothing = n.parts[0] == c.ZERO and whole.kind == "op" and whole.head == "*"
            return c.ZERO if nothing else whole.change(rule)  # of nothing: repmat of an empty one
        if n.kind == "if":
            return _asked(n, rule)
        return _meaning(n)

    return body.change(rule)


def _given(n: Node, rule: Any) -> Node:
    to, given = n.parts
    pointers = to.kind == "index" and to.parts[0].head in ("arg", "res", "arg1", "res1")
    if pointers and given == c.ZERO:
        return c.op(to, "=", c.name("NULL"))
    made = given.change(rule)
    if _is_truth(given) and not pointers:
        made = Node("choice", "", (made, constant(1.0), _NO_REAL))
    return c.op(to.change(rule), "=", made)


def _asked(n: Node, rule: Any) -> Node | None:
    """A branch on a pointer, on what a function gives back, or on a flag."""
    asked = n.parts[0]
    flag = asked.kind == "choice" and asked.parts[1].kind == "call"
    if asked.kind == "index" and asked.parts[0].head in ("arg", "res", "arg1", "res1"):
        made = c.op(asked, "!=", c.name("NULL"))
    elif asked.kind == "call" or flag:
        made = c.op((asked.parts[1] if flag else asked).change(rule), "!=", c.ZERO)
    else:
        return None
    return replace(n, parts=(made, *(p.change(rule) for p in n.parts[1:])))


def _quiet(head: Node, body: Node) -> list[Node]:
    """Statements of a function, before them those that name the arguments that it does not use."""
    names = [p.parts[0] for p in head.parts if p.parts]
    while any(n.kind in ("unary", "index") for n in names):
        names = [n.parts[0] if n.kind in ("unary", "index") else n for n in names]
    return [*(c.mark_unused(n.head) for n in names if not body.uses(n.head)), *body.parts]
