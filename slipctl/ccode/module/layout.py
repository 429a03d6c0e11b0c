"""Names and places in C: which struct member carries which signal of a Block."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from typing import Any

import casadi as ca
import numpy as np

from slipctl.block.block import Block
from slipctl.block.signals import Signal
from slipctl.ccode.module.comments import ascii_text
from slipctl.ccode.passes.precision import size
from slipctl.ccode.tree.expressions import number
from slipctl.ccode.tree.helpers import all_helpers
from slipctl.ccode.tree.nodes import Node, assign
from slipctl.ccode.tree.parser import code, expression
from slipctl.errors import BadInput

_C_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while asm bool catch class const_cast delete dynamic_cast explicit export false friend
mutable namespace new operator private protected public reinterpret_cast static_cast template this
throw true try typeid typename using virtual wchar_t and or not xor constexpr decltype nullptr
noexcept alignas alignof thread_local NAN INFINITY NULL EOF I
"""
KEYWORDS = frozenset(_C_WORDS.split())
"""Words that C or C++ keep, and macros of the headers a caller is likely to have."""

_LOCAL_WORDS = """
in out param state next now status arg res iw w mem exp log pow sqrt sin cos tan asin acos atan
atan2 sinh cosh tanh asinh acosh atanh floor ceil fmod remainder fabs copysign erf erfc log1p expm1
hypot gamma lgamma tgamma j0 j1 jn y0 y1 yn equations failed limited param_ok in_finite
result_finite hold safe main check_inputs states_within start recover guard part part_off off
refused told in_force used limit_outputs start_outputs mark fresh derived work own defaults
untouched good whole which INITIALISED UNSURE FORGOTTEN PATIENCE
"""
LOCAL = frozenset((*_LOCAL_WORDS.split(), *all_helpers(), "i", "j", "k"))
"""Names that mean something inside the generated functions; loops count by the last three."""

_MATH = """
acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs
fdim floor fma fmax fmin fmod frexp hypot ilogb ldexp lgamma llrint llround log log10 log1p log2
logb lrint lround modf nan nearbyint nextafter nexttoward pow remainder remquo rint round scalbln
scalbn sin sinh sqrt tan tanh tgamma trunc
"""
_OTHER = """
abort abs atexit atof atoi atol atoll bsearch calloc div exit free getenv labs ldiv llabs lldiv
malloc qsort rand realloc srand strtod strtol strtoul system memchr memcmp memcpy memmove memset
strcat strchr strcmp strcoll strcpy strcspn strerror strlen strncat strncmp strncpy strpbrk strrchr
strspn strstr strtok strxfrm fprintf printf putchar puts fputc fputs fscanf scanf snprintf sprintf
sscanf vfprintf vprintf vscanf vsnprintf vsprintf isalnum isalpha iscntrl isdigit isgraph islower
isprint ispunct isspace isupper isxdigit tolower toupper clock raise remove rename
"""
LIBRARY = frozenset(n + e for n in _MATH.split() for e in ("", "f", "l")) | {*_OTHER.split()}
"""Functions of C's library, which compilers know of: no function of a module has such a name."""


_FILE_WORDS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdarg
stdbool stddef stdint stdio stdlib string tgmath time wchar wctype
example cortex_m fmi2 fmi3 makefile xcp xcp_board
all all_build clean edit_cache help install package package_source preinstall rebuild_cache
run_tests test zero_check
aux con nul prn
"""
FILES = frozenset(_FILE_WORDS.split())
"""Headers of C, other files of the folder, targets of make and CMake, devices of Windows: no module
has such a name, in letters of either case."""


@dataclass(frozen=True)
class Member:
    """A struct member: the signal it carries and its C name."""

    signal: Signal
    c: str

    @property
    def name(self) -> str:
        """Name of the signal, dots included."""
        return self.signal.name

    @property
    def size(self) -> int:
        """Number of elements."""
        return self.signal.size

    @property
    def scalar(self) -> bool:
        """Whether it is a plain number in C; a vector of one element is an array."""
        return self.signal.shape == ()

    def at(self, pointer: str, k: int) -> str:
        """C expression of element k."""
        return f"{pointer}{self.c}" if self.scalar else f"{pointer}{self.c}[{k}]"

    def node(self, pointer: str, k: int) -> Node:
        """The same as a node."""
        return expression(self.at(pointer, k))

    @property
    def all(self) -> Member:
        """What all copies have of it; itself where there are none."""
        return self

    def array(self, pointer: str) -> str:
        """C expression of the array, or of the number."""
        return f"{pointer}{self.c}"

    def elements(self, k: int) -> list[int]:
        """Numbers of element k, in the array of all."""
        return [k]

    def address(self, pointer: str) -> str:
        """C expression of the address of its first element."""
        return f"&{pointer}{self.c}" if self.scalar else f"{pointer}{self.c}"

    def declared(self, real: str, name: str = "") -> str:
        """Declaration inside a struct, by its C name or another, in this precision."""
        name = name or self.c
        return f"{real} {name};" if self.scalar else f"{real} {name}[{self.size}];"


def spans(members: Iterable[Member]) -> Iterator[tuple[Member, slice]]:
    """Each member with its place in a row of the elements of all."""
    end = 0
    for m in members:
        end += m.size
        yield m, slice(end - m.size, end)


@dataclass(frozen=True)
class Copy(Member):
    """What one of several copies has of a member.

    Attributes:
        axis: what the copies are, and their index in C; 0 of one that is alone.
        of: what all of them have.
        local: pointer to the own elements, where there are several.
    """

    axis: str
    of: Member
    local: str = ""

    @property
    def all(self) -> Member:
        """What all copies have of it."""
        return self.of.all

    def at(self, pointer: str, k: int) -> str:
        """C expression of element k of the copy."""
        if self.local:
            return f"{self.local}[{k}]"
        alone = self.size == self.of.size
        return self.of.at(pointer, k) if alone else f"{self.of.array(pointer)}[{self.axis}]"

    def array(self, pointer: str) -> str:
        """C expression of the array that the elements of the copy are in."""
        return self.local or self.of.array(pointer)

    def elements(self, k: int) -> list[int]:
        """Numbers of element k of each copy, in the array of all."""
        own = range(k, self.of.size, self.size)
        return [i for j in own for i in self.of.elements(j)]

    def pointers(self, struct: str, const: bool) -> dict[str, str]:
        """Declarations of the pointers that it needs, by their names."""
        found = self.of.pointers(struct, const) if isinstance(self.of, Copy) else {}
        if self.local:
            start = f"&{self.of.array(struct)}[{self.size} * {self.axis}]"
            found[self.local] = f"{'const ' * const}double *const {self.local} = {start};"
        return found


@dataclass(frozen=True)
class Layout:
    """Members of the structs of one C module.

    Attributes:
        kinds: types of members that are no real numbers, by the struct, ``now`` or ``kept``, and
            the C name.
    """

    name: str
    inputs: tuple[Member, ...]
    params: tuple[Member, ...]
    derived: tuple[Member, ...]
    states: tuple[Member, ...]
    outputs: tuple[Member, ...]
    measured: tuple[Member, ...] = ()
    kinds: Mapping[tuple[str, str], str] = field(default_factory=dict)

    def words(self, real: str) -> dict[str, Any]:
        """What templates say of a module: its name, type of numbers, how many there are of each."""
        groups = {"n_in": self.inputs, "n_param": self.params, "n_derived": self.derived,
                  "n_state": self.states, "n_out": self.outputs}  # fmt: skip
        counts = {k: sum(m.size for m in g) for k, g in groups.items()}
        return {"n": self.name, "big": self.big, "real": real, **counts}

    @property
    def signals(self) -> tuple[Member, ...]:
        """What the equations of a tick give: outputs, and what is measured beside them."""
        return (*self.outputs, *self.measured)

    @property
    def now(self) -> str:
        """Type of the struct that they are in."""
        return f"struct {self.name}_signals" if self.measured else f"{self.name}_out"

    def kind(self, m: Member, real: str) -> str:
        """Type in C of a member, with numbers of this one."""
        struct = {"state": "kept", "output": "now"}.get(m.signal.role, "")
        return self.kinds.get((struct, m.c), real)

    def offsets(self, real: str) -> list[int]:
        """Bytes from the begin of what a tick gives to each of its members, and to its end."""
        return self._bytes(self.signals, real, 0)

    def kept_offsets(self, real: str) -> list[int]:
        """Bytes from the begin of what is kept to each state, and to its end."""
        found, at = list[int](), 0
        for _, own in self.kept:
            *places, at = self._bytes(own, real, at)
            found += places
        return [*found, -(-at // size(real)) * size(real)]

    def _bytes(self, members: Sequence[Member], real: str, at: int) -> list[int]:
        """Where members of a struct lie that follows what ends ``at``, and where it ends."""
        width = {"bool": 1, "int": 4, "unsigned int": 4, real: size(real)}
        widths = [width[self.kind(m, real)] for m in members]
        most = max(widths)
        at, found = -(-at // most) * most, []
        for m, each in zip(members, widths, strict=True):
            found.append(-(-at // each) * each)
            at = found[-1] + each * m.size
        return [*found, -(-at // most) * most]

    @property
    def big(self) -> str:
        """Name in capitals, for constants."""
        return self.name.upper()

    @cached_property
    def kept(self) -> tuple[tuple[str, tuple[Member, ...]], ...]:
        """States by the struct of their part, as they lie in memory; those of "" are in none.

        A part whose states do not lie together has no struct.
        """
        groups = [
            (path, tuple(own))
            for path, own in groupby(self.states, lambda m: m.name.rpartition(".")[0])
        ]
        names = [path and c_name(path) for path, _ in groups]
        taken = {m.c for m in self.states}

        def struct(path: str, own: tuple[Member, ...]) -> str:
            name = path and c_name(path)
            free = names.count(name) == 1 and name not in taken
            return name if free and all(m.c != "in_force" for m in own) else ""

        return tuple((struct(path, own), own) for path, own in groups)

    @cached_property
    def places(self) -> dict[str, str]:
        """Where a state lies in the struct of all that is kept, by its C name."""
        return {
            m.c: f"{struct}.{own_name(m)}" if struct else m.c
            for struct, own in self.kept for m in own
        }  # fmt: skip


def layout(block: Block, name: str, measured: Iterable[Signal] = ()) -> Layout:
    """Give each signal of a block its member.

    Args:
        block: a step or a law.
        name: prefix of functions and structs.
        measured: outputs of its parts that it does not give.

    Raises:
        BadInput: ``name`` is no C identifier, or a file has it already; two signals would have one
            C name; a parameter without value.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        raise BadInput(
            f"{name!r} cannot name a C file and its functions; take a letter, then letters, digits"
            " or _"
        )
    if name.lower() in FILES:
        raise BadInput(
            f"{name!r} cannot name a C file and its functions: C, make, CMake or Windows keep it;"
            f" take another, such as {name}_law"
        )
    for p in block.params.values():
        if p.value is None:
            where = "" if p.unit == "1" else f" in {p.unit}"
            raise BadInput(f"{block.name}.{p.name} has no value; give it a default{where}")
        places_of(block.params, p.name)
    free = [s for s in block.params.values() if not s.derived]
    derived = [s for s in block.params.values() if s.derived]
    return Layout(
        name,
        _members(block, block.inputs.values()),
        _members(block, free),
        _members(block, derived),
        _members(block, block.states.values()),
        _members(block, block.outputs.values()),
        _members(block, measured),
    )


def c_name(name: str) -> str:
    """C name of a signal: dots become underscores, words of C get one at the end."""
    plain = re.sub(r"\W", lambda m: "_" if m[0] == "." else ascii_text(m[0]), name)
    plain = re.sub(r"[^\x00-\x7f]", lambda m: ascii_text(m[0]), plain)
    return plain + "_" if plain in KEYWORDS or not re.match("[A-Za-z_]", plain) else plain


def own_name(m: Member) -> str:
    """C name of a signal inside the struct of its part."""
    return c_name(m.name.rpartition(".")[2])


def _members(block: Block, signals: Iterable[Signal]) -> tuple[Member, ...]:
    members: dict[str, Member] = {}
    for s in signals:
        c = c_name(s.name)
        if c in members:
            raise BadInput(
                f"{block.name}: {members[c].name!r} and {s.name!r} would both be {c!r} in C;"
                " rename one"
            )
        members[c] = Member(s, c)
    return tuple(members.values())


def range_text(s: Signal) -> str:
    """Range of a signal in words, ends that follow parameters as they are declared."""
    if s.values:
        return s.meanings
    lo = [number(s.lo)] * (s.lo > float("-inf")) + [
        b.expression for b in s.bounds if b.what == "lo"
    ]
    hi = [number(s.hi)] * (s.hi < float("inf")) + [b.expression for b in s.bounds if b.what == "hi"]
    low, high = " and ".join(lo), " and ".join(hi)
    if lo and hi:
        return f"{low} to {high}"
    return f"at least {low}" if lo else f"at most {high}" if hi else ""


def change_text(s: Signal) -> str:
    """Largest change per tick of a signal in words."""
    own = [number(s.change)] * (s.change < float("inf"))
    return " and ".join([*own, *(b.expression for b in s.bounds if b.what == "change")])


def noise_text(s: Signal) -> str:
    """Noise of a signal in words, empty if none is declared."""
    own = [number(s.jitter)] * (s.jitter > 0)
    return " and ".join([*own, *(b.expression for b in s.bounds if b.what == "noise")])


# ---- values in the shapes of C: dense, rows and columns, one after the other ---------------------


def dense_value(block: Block, signal: Signal, value: Any) -> Any:
    """One value, dense and in the shape that its signal declares, as the block packs it."""
    rows, columns = matrix(signal)
    if isinstance(value, (list, tuple)):
        value = ca.vertcat(*value)
    if not hasattr(value, "shape") or isinstance(value, np.ndarray):
        value = ca.DM(np.asarray(value, dtype=float))
    if tuple(value.shape) != (rows, columns):
        if value.numel() == 1:
            value = ca.repmat(value, rows, columns)
        elif value.numel() == rows * columns:
            value = ca.reshape(value, rows, columns)
        elif value.numel() == columns:  # a number for each copy
            value = ca.repmat(ca.vec(value).T, rows, 1)
        else:
            raise BadInput(
                f"{block.name}.{signal.name} has shape {tuple(value.shape)}, declared"
                f" {signal.shape}"
            )
    return ca.densify(value)


def matrix(signal: Signal) -> tuple[int, int]:
    """Rows and columns of a signal."""
    s = signal.shape
    return (s[0], s[1]) if len(s) == 2 else (math.prod(s), 1)


def constant(signal: Signal, value: Any) -> np.ndarray:
    """A constant in rows and columns."""
    return np.broadcast_to(np.asarray(value, dtype=float), signal.shape).reshape(matrix(signal))


def c_elements(m: Member, value: Any) -> np.ndarray:
    """Elements of one value in the order of C: column by column."""
    return constant(m.signal, value).ravel(order="F")


def of_each_copy(values: Sequence[Node], rows: int) -> bool:
    """Whether the numbers of each column are one number."""
    return rows > 1 and all(v == values[k - k % rows] for k, v in enumerate(values))


def started_copies(m: Member, pointer: str, values: Sequence[Node]) -> list[Node]:
    """Statements that give the numbers of each column its first one."""
    rows, array = m.signal.shape[0], f"{pointer}{m.c}"
    heads = [assign(m.node(pointer, k), values[k]) for k in range(0, m.size, rows)]
    rest = f"for (int k = 1; k < {m.size}; ++k) {{ if ((k % {rows}) != 0) {{" \
           f" {array}[k] = {array}[k - 1]; }} }}"  # fmt: skip
    return [*heads, *code(rest)]


def places_of(params: Mapping[str, Signal], name: str) -> tuple[str, ...]:
    """Parameters of the places over which a table is, one for each axis; none if it is no table.

    A part tells the name as it has it. In the whole it is another, or shared with other parts.

    Raises:
        BadInput: there are no such places, or another number of them.
    """
    table = params[name]
    axes = (table.over,) if isinstance(table.over, str) else table.over
    if axes == ("",):
        return ()
    if len(axes) != len(table.shape):
        raise BadInput(
            f"{name} has shape {table.shape} and is a table over {len(axes)} axes; name"
            f" {len(table.shape)}, over=(..., ...)"
        )
    return tuple(
        _place(params, name, axis, (n,)) for axis, n in zip(axes, table.shape, strict=True)
    )


def _place(params: Mapping[str, Signal], name: str, axis: str, shape: tuple[int, ...]) -> str:
    path = name.split(".")[:-1]
    found = [".".join([*path[:k], axis]) for k in range(len(path), -1, -1)]
    there = next((n for n in found if n in params), "")
    if not there or not params[there].rising or params[there].shape != shape:
        raise BadInput(
            f"{name} is a table over {axis!r}, which is no parameter of as many places;"
            f" declare {axis} = Param(..., shape={shape}, rising=True)"
        )
    return there
