"""No run-time error, and every range kept, for any number of ticks: proven by Frama-C's Eva.

Eva computes with sets of numbers what a program can do. The harness sets the module up, then steps
without end, each input any number at all in every tick. What must hold: no alarm, and every state
and output in its declared range after every tick. An alarm is an index out of bounds, an
uninitialised number, an overflow of integers, or a conversion that does not fit.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from slipctl.ccode.check.proof import function_proof, kernel_proof
from slipctl.ccode.compile.programs import find_program, run_program, scratch_folder
from slipctl.ccode.module.layout import Member
from slipctl.ccode.module.plan import Plan
from slipctl.ccode.passes.split_step import equations_call
from slipctl.errors import RunFailed

SECONDS = 120
"""CPU time in s for a proof; a module that is not through by then is not proven."""

TURNS = 256
"""Turns of a loop up to which each is told from the others."""

HARNESS, GUARDS, EQUATIONS = "harness.c", "guards.c", "equations.c"
"""Files that are analysed: steps without end, of a module whose equations give any numbers, and
one pass of the equations."""

Row = tuple[float, float]
"""Least and largest value of a number."""

FREE = ("-warn-special-float", "none")
"""NaN and infinity are numbers."""

_WRITTEN_OUT = {
    "(x >= lo) && (x <= hi)": "(x == x) && (x >= lo) && (x <= hi)",
    "if ((value >= lo) && (value <= hi)": "if ((value == value) && (value >= lo) && (value <= hi)",
    "((at > -1.0) &&": "((at == at) && (at > -1.0) &&",
    "((at > -1.0f) &&": "((at == at) && (at > -1.0f) &&",
    "if ((*x >= lo) && (*x <= hi)) {": "if ((*x == *x) && (*x >= lo) && (*x <= hi)) {",
}
"""A comparison with NaN is false. Eva 25 does not know that, so it is written out for it."""

_TWICE = re.compile(
    r"^( +)(for \([^\n]*\{\n +(?:double|float) (?:\w+_one|\*const \w+ = \(\(i % 2\)))",
    re.MULTILINE,
)
"""Loops that sum over samples, or call a function with what it gave, in two arrays by turns."""

ASSUMPTIONS = (
    "the caller calls init once, then step, with the default parameters, which stay",
    "inputs are any numbers in every tick, NaN and infinite ones too, in range or not",
    "arithmetic is that of IEEE 754, rounded to nearest, and the compiler keeps it"
    " (no -ffast-math, -ffp-contract=off); int has 32 bits",
    "a comparison with NaN is false; in the analysed text that is written out, as x == x",
    "functions of the C library do what Frama-C's headers and builtins say of them",
)
"""What a proof takes for true."""


def tool() -> str:
    """Path of Frama-C.

    Raises:
        BadInput: not installed.
    """
    return find_program("frama-c", "--prove", "frama-c-base")


def harness(plan: Plan) -> str:
    """Text of the program that is analysed: init, then steps without end."""
    n, lay = plan.name, plan.layout
    ends = _ends(plan)
    hints = sorted({v for (what, _), rows in ends.items() if what != "in" for r in rows for v in r})
    body: list[str] = []
    for m in lay.inputs:
        body += _each(m, "in.", [None], lambda at, _: f"{at} = any;")
    step = f"{n}_step{'_counted' * plan.counter}"
    counted = ", number" * plan.counter
    body.append(f"(void){step}(&in, &param, &state, &out{counted});")
    for what, place, members in (
        ("state", "state.kept.", lay.states), ("out", "out.", lay.outputs)
    ):  # fmt: skip
        for m in members:
            body += _each(m, place, ends.get((what, m.c), []), partial(_check, what, m))
    structs = [f"    static {n}_{what} {what};" for what in ("param", "state", "in", "out")]
    widened = f'    /*@ widen_hints "all", {", ".join(v.hex() for v in hints)}; */'
    lines = [
        f'#include "{n}.h"', "", f"static volatile {plan.real} any;",
        "static volatile int more;", *["static volatile unsigned int number;"] * plan.counter,
        "", "int main(void)", "{", *structs, "    int k;",
        f"    {n}_default(&param);", f"    (void){n}_init(&param, &state);",
        *[widened] * bool(hints), "    while (more != 0) {",
        *(f"        {line}" for line in body), "    }", "    return 0;", "}", "",
    ]  # fmt: skip
    return with_structs(plan, "\n".join(lines))


def equations_harness(plan: Plan, finite: bool = False) -> str:
    """Text of the program that is analysed: the equations once, from any state in its ranges.

    A state without a range is any number. So is each input, if not ``finite``. What nobody has set
    is unset.
    """
    n, lay, ends = plan.name, plan.layout, _ends(plan)
    body: list[str] = []
    for what, where, members in (
        ("in", "state->guard.last.", lay.inputs), ("state", "state->kept.", lay.states)
    ):  # fmt: skip
        for m in members:
            rows = ends.get((what, m.c), [None]) if finite or what == "state" else [None]
            body += _each(m, where, rows, partial(_drawn, lay.kind(m, plan.real)))
    following = "state->next" if plan.next_in_state else "next"
    lines = [
        f'#include "{n}.c"', "", f"static volatile {plan.real} any;",
        "static volatile int whole;", f"static {n}_param param;", "", "int main(void)", "{",
        f"    {n}_state all;", f"    {n}_state *const state = &all;",
        f"    const {n}_param *const used = &all.in_force;", f"    {lay.now} now;",
        *[f"    struct {n}_kept next;"] * (bool(lay.states) and not plan.next_in_state),
        "    int k;", f"    {n}_default(&param);", f"    (void){n}_init(&param, state);",
        *(f"    {line}" for line in body),
        *[f"    {following} = state->kept;"] * bool(plan.equations.ticks),
        f"    (void){equations_call(plan, '&state->guard.last')};", "    return 0;", "}", "",
    ]  # fmt: skip
    return with_structs(plan, "\n".join(lines))


def with_structs(plan: Plan, text: str) -> str:
    """Text of a harness in which a state of a part is a member of the struct of that part."""
    moved = {c: place for c, place in plan.layout.places.items() if c != place}
    if not moved:
        return text
    use = re.compile(r"((?:\bnext->|\b(?:kept|next)\.))(" + "|".join(moved) + r")\b")
    return use.sub(lambda m: m[1] + moved[m[2]], text)


def run_eva(
    plan: Plan, made: Mapping[str, str], seconds: int = SECONDS, finite: bool = True
) -> dict[str, Any]:
    """Run Eva on a module, with special floats allowed and then without.

    The proof is by induction. Whatever the equations give (:func:`any_results`), the guards keep
    every range, tick after tick. From any state in its ranges one pass of the equations
    (:func:`equations_harness`) does nothing wrong. A module of several rates is followed as it is.

    Args:
        plan: the module.
        made: text of its files by name.
        seconds: CPU time of each run.
        finite: whether NaN and infinity are taken for alarms in one more.

    Returns:
        ``tool``, ``options``, ``assumptions``, ``seconds``; ``ended``: whether both came to an end;
        ``alarms``: file, line, function, kind and condition of each; ``ranges``: how many are
        ``proven``, out of how many, which are ``open``, and which states and outputs have none
        (``without``), so that nothing is claimed of them; ``non_finite``: the number
        of alarms of the equations where NaN and infinity are alarms too, of finite inputs, null if
        that did not end or was not tried, as of a module that is proven function by function;
        ``functions``: how
        many of these come to their end, of how many, each by itself (:mod:`function_proof`, and
        :mod:`kernel_proof` for CasADi's text, where each returns 0);
        ``passed``: no alarm, and every range proven. Where the guards alone came to an end
        ``of_guards`` is true: ``alarms`` and ``ranges`` are theirs, and it has not passed.

    Raises:
        BadInput: Frama-C is not installed.
        RunFailed: it refuses the module.
    """
    frama_c, n = tool(), plan.name
    texts = {f: made[f] for f in plan.files[1:]}
    options = _options(plan, "".join(texts.values()))
    files, contracts = _with_contracts(plan, texts)
    free, steps = any_results(plan, files[f"{n}.c"]), harness(plan)
    halves = free != files[f"{n}.c"]
    programs = {f"{n}.h": made[f"{n}.h"], **files, HARNESS: steps, GUARDS: free}
    asked = [[HARNESS, GUARDS]]
    if halves:
        programs[EQUATIONS] = equations_harness(plan)
        asked.append([EQUATIONS])
    if contracts:
        asked.append([kernel_proof.PROOFS])
    with scratch_folder(programs) as folder:
        found = [_analysed(folder, [frama_c, *a, *options, *FREE], seconds) for a in asked]
        ended = all(rows is not None for rows, _ in found)
        strict = None
        if finite and ended and halves and not contracts:
            (folder / EQUATIONS).write_text(equations_harness(plan, True), encoding="utf-8")
            strictly = [frama_c, EQUATIONS, *options, "-warn-special-float", "non-finite"]
            strict, _ = _analysed(folder, strictly, seconds)
    rows = [row for rows, _ in found for row in rows or []]
    claims = _claims(steps)
    good = {int(r["line"]) for r in rows if r["file"] == HARNESS and _valid(r)}
    open_ = list(dict.fromkeys(name for line, name in claims.items() if line not in good))
    of = len(set(claims.values()))
    alarms = _alarms(rows, plan)
    through = sum(
        r["file"] == kernel_proof.PROOFS and r["property kind"] == "user check"
        and r["status"] == "Valid" for r in rows
    )  # fmt: skip
    said = run_program([frama_c, "-version"])
    return {
        "tool": f"Frama-C {said.stdout.strip()}, Eva",
        "options": " ".join([*FREE, *options]),
        "assumptions": list(ASSUMPTIONS),
        "seconds": round(sum(used for _, used in found), 1), "limit_seconds": seconds,
        "ended": ended,
        "of_guards": not ended and found[0][0] is not None,
        "alarms": alarms,
        "ranges": {"proven": of - len(open_), "of": of, "open": open_, "without": _unclaimed(plan)},
        "functions": {"ended": through, "of": contracts},
        "non_finite": None if strict is None else len(_alarms(strict, plan)),
        "passed": ended and not alarms and not open_ and through == contracts,
    }  # fmt: skip


def _with_contracts(plan: Plan, texts: Mapping[str, str]) -> tuple[dict[str, str], int]:
    """Text to prove by name, and how many functions are proven each by itself where that is so."""
    n = plan.name
    files = {f: written_out(t) for f, t in texts.items()}
    if plan.equations.static:
        home, (_, _, iw, w) = plan.files[1], plan.equations.work
        found, contracts = kernel_proof.text_with_contracts(
            n, home, files[home], plan.real, (iw, w - plan.equations.in_arrays)
        )
        return files | found, contracts
    if plan.equations.arrays:
        called = plan.equations.functions
        return function_proof.text_with_contracts(n, files, plan.real, called)
    return files, 0


def written_out(text: str) -> str:
    """Source with the comparisons that NaN decides written out; lines keep their numbers.

    Some loops are marked: two turns are told apart, and all others taken together.
    """
    for short, long in _WRITTEN_OUT.items():
        text = text.replace(short, long)
    return _TWICE.sub(r"\1/*@ loop unroll 2; */ \2", text)


_EQUATIONS = re.compile(r"^static (void|int) equations\((?:[^{;]*)\)\n\{\n(.*?)^\}", re.M | re.S)


def any_results(plan: Plan, text: str) -> str:
    """Source of which the equations give any numbers; other lines keep their numbers.

    What is proven of it holds whatever the equations are: it is what the guards do.
    """
    found = _EQUATIONS.search(text)
    if found is None:
        return text
    lay = plan.layout
    given = [a for a in ("in", "param", "derived", "state", "work") if f"*{a}" in found[0]]
    body = ["int k;", *(f"(void){a};" for a in given)]
    for pointer, members in (("next", lay.states), ("now", lay.signals)):
        for m in members:
            body += _each(m, f"{pointer}->", [None], partial(_drawn, lay.kind(m, plan.real)))
    body += ["return 0;"] * (found[1] == "int")
    line = with_structs(plan, " ".join(body)) + "\n" * found[2].count("\n")
    declared = f"static volatile {plan.real} any; static volatile int whole; "
    return (
        text[: found.start()] + declared + text[found.start() : found.start(2)] + line
        + text[found.end(2) :]
    )  # fmt: skip


def summary(data: Mapping[str, Any]) -> str:
    """One line on a proof."""
    ranges, alarms = data["ranges"], len(data["alarms"])
    if not data["ended"]:
        said = f"Frama-C: no end in {data['limit_seconds']} s, nothing is proven of the equations"
        if data.get("of_guards"):
            said += (
                f"; of the guards, whatever the equations give: {alarms} alarms,"
                f" {ranges['proven']} of {ranges['of']} ranges proven"
            )
        return said
    finite = data["non_finite"]
    strict = "no result" if finite is None else f"{finite} alarms"
    functions = data.get("functions", {"of": 0})
    if functions["of"]:
        strict += f"; one by one: {functions['ended']} of {functions['of']} functions end"
    without = len(ranges["without"])
    none = f"; signals without a range: {without}" if without else ""
    return (
        f"Frama-C: {alarms} alarms, {ranges['proven']} of {ranges['of']} ranges proven{none}"
        f" (NaN and infinity as alarms: {strict}):"
        f" {'proven' if data['passed'] else 'NOT PROVEN'}"
    )


# ---- small parts --------------------------------------------------------------------------------


def _unclaimed(plan: Plan) -> list[str]:
    """States and outputs without a range: of them nothing is claimed."""
    lay = plan.layout
    numbers = [m for m in (*lay.states, *lay.outputs) if lay.kind(m, plan.real) == plan.real]
    return [m.name for m in numbers if not plan.ranged(m)]


def _ends(plan: Plan) -> dict[tuple[str, str], list[tuple[float, float]]]:
    """Range of each element of each number that has one, with the default parameters."""
    values = plan.block.param_values()
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    lay = plan.layout
    for what, members in (("in", lay.inputs), ("state", lay.states), ("out", lay.outputs)):
        for m in filter(plan.ranged, members):
            lo, hi, *_ = plan.ends([m], values)
            found[what, m.c] = [(float(a), float(b)) for a, b in zip(lo, hi, strict=True)]
    return found


def _check(what: str, m: Member, at: str, row: Row) -> str:
    """A claim; hexadecimal, as a decimal number is a real one there and not the nearest double."""
    return f"/*@ check {what}_{m.c}: {row[0].hex()} <= {at} <= {row[1].hex()}; */"


def _drawn(kind: str, place: str, row: Row | None) -> str:
    """A statement that makes a number of a kind any one in its range, if it has one."""
    kinds = {"bool": "(whole != 0)", "int": "whole", "unsigned int": "(unsigned int)whole"}
    drawn = f"{place} = {kinds.get(kind, 'any')};"
    if kind == "bool" or row is None:
        return drawn
    integer = kind in ("int", "unsigned int")
    low, high = (f"({kind}){int(x)}" if integer else x.hex() for x in row)
    inside = f"({place} == {place}) && ({place} >= {low}) && ({place} <= {high})"
    return f"{drawn} if (!({inside})) {{ {place} = {low}; }}"


def _each(
    m: Member, where: str, rows: Sequence[Any], statement: Callable[[str, Any], str]
) -> list[str]:
    """Statements for the elements of a member, of place and row; a loop where rows are alike."""
    if len(set(rows)) != 1:
        return [statement(m.at(where, k), row) for k, row in enumerate(rows)]
    if m.scalar:
        return [statement(f"{where}{m.c}", rows[0])]
    one = statement(f"{where}{m.c}[k]", rows[0])
    return [f"for (k = 0; k < {m.size}; ++k) {{", f"    {one}", "}"]


def _options(plan: Plan, text: str) -> list[str]:
    """Options of Eva: how many cases are kept apart in which function."""
    lay = plan.layout
    largest = max((m.size for m in (*lay.inputs, *lay.states, *lay.outputs)), default=1)
    turns = [int(n) for n in re.findall(r"\bfor \([^;]*; \w+ < (\d+); ", text)]
    largest = max([largest, *(n for n in turns if n <= TURNS)])  # an array that such a loop fills
    states = sum(m.size for m in plan.layout.states)
    wanted = {
        "within": 8, "limit": 8, "can_follow": 8, "accept": 16,
        "all_within": 4 * largest + 16, "limit_all": 4 * largest + 16, "check_inputs": 8,
        "part_off": 4 * states + 64, f"{plan.name}_step": 64,
        "reached": 8 * max(map(int, re.findall(r"reached\([\w>-]+, (\d+)", text)), default=0),
    }  # fmt: skip
    wanted |= function_proof.kept_apart(text)
    there = [
        f"{f}:{k}" for f, k in wanted.items() if re.search(rf"^(?:static )?\w.*\b{f}\(", text, re.M)
    ]
    decided = ("within", "all_within", "can_follow", "part_off")
    split = ",".join(f"{f}:0" for f in decided if any(x.startswith(f"{f}:") for x in there))
    options = [
        "-eva", "-eva-slevel-function", ",".join(there), "-eva-auto-loop-unroll",
        str(max(128, largest)), "-eva-widening-period", "1",
        *(["-eva-split-return-function", split] if split else []),
    ]  # fmt: skip
    return options


def _analysed(
    folder: Path, command: Sequence[str], seconds: int
) -> tuple[list[dict[str, str]] | None, float]:
    """Properties that Eva decided or left open, None if it did not end; CPU seconds."""
    told = folder / "told.csv"
    told.unlink(missing_ok=True)
    before = os.times()
    limited = ["sh", "-c", f'ulimit -t {seconds}; exec "$@"', "sh", *command]
    done = run_program([*limited, "-then", "-report", "-report-csv", told.name], folder)
    after = os.times()
    used = sum(after[2:4]) - sum(before[2:4])
    if done.returncode < 0 or used >= 0.98 * seconds:  # it is told to stop, and says so itself
        return None, used
    if done.returncode or not told.exists():
        said = [line for line in done.stdout.splitlines() if "rror" in line]
        raise RunFailed(f"frama-c fails: {(said or [done.stderr.strip()])[0][:200]}")
    with told.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter="\t")), used


def _claims(text: str) -> dict[int, str]:
    """What each line of a harness claims to be in its range."""
    lines = enumerate(text.splitlines(), start=1)
    found = {k: re.search(r"/\*@ check (\w+):", line) for k, line in lines}
    return {k: m[1].replace("_", ".", 1) for k, m in found.items() if m}


def _valid(row: Mapping[str, str]) -> bool:
    return row["status"] in ("Valid", "Considered valid") or "dead" in row["status"].lower()


def _alarms(rows: Sequence[Mapping[str, str]], plan: Plan) -> list[dict[str, Any]]:
    """What may go wrong in the module itself; reading any number in the harness may not."""
    own = {f: f for f in (*plan.files, kernel_proof.CONTRACTS, kernel_proof.PROOFS)}
    own[GUARDS] = f"{plan.name}.c"  # lines are the same
    found = [
        {"file": own[r["file"]], "line": int(r["line"]), "function": r["function"],
         "kind": r["property kind"], "condition": r["property"]}
        for r in rows
        if r["file"] in own and not _valid(r)
    ]  # fmt: skip
    return [f for k, f in enumerate(found) if f not in found[:k]]
