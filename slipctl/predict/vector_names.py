"""Names of the numbers in the vectors of a predictive controller, for C that a person reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from slipctl.block.fields import VectorNames
from slipctl.predict.stages.horizon import Horizon, Layout
from slipctl.predict.tracks import elements

if TYPE_CHECKING:
    from slipctl.predict.qp.active_set import ActiveSet

_STAGE, _END = (
    ("A", "B", "offset", "H", "gradient", "excess", "excess_slope", "cap"),
    ("H", "gradient", "excess", "excess_slope", "cap"),
)
"""Pieces of the column of a stage, and of the last one, as :class:`Stage` has them."""


def vector_names(h: Horizon, qp: ActiveSet) -> VectorNames:
    """Names in the vectors of all Functions of a problem and of its quadratic program.

    Args:
        h: the problem.
        qp: what solves its program.
    """
    states = _short(elements(h.model, "state"))
    controls = _short(h.controls)
    rows = [f"{n}_{end}" for n in _short(h.soft) for end in ("above", "below")]
    followed = [f"{n}_before" for n in controls] if qp.memory else []
    z = [*states, *followed]
    stage, end = _pieces(qp.stage, _STAGE), _pieces(qp.end, _END)
    A = qp.stage.sparsity[0].nnz()
    B = qp.stage.sparsity[1].nnz()
    gain = [f"K_{i}_{j}" for j in range(qp.nz) for i in range(h.nu)] + _many("step", h.nu)
    cross = [f"Qvz_{i}_{j}" for j in range(qp.nz) for i in range(h.nu)]
    inner = [f"Qvv_{i}_{j}" for j in range(h.nu) for i in range(h.nu)]
    common = {
        "point": ("state", states), "point_next": ("state", states),
        "point_after": ("state", states), "after": ("state", states), "dx": ("state", states),
        "d": ("held", _short(h.held)), "q": ("constant", _constants(h)),
        "S": ("stage", stage[:A]), "S_next": ("stage", stage[:A]), "F": ("stage", stage[:A]),
        "Su": ("slope_of_control", _many("B", B)), "G": ("slope_of_control", _many("B", B)),
        "Su_next": ("slope_of_control", _many("B", B)),
        "P": ("cost", _triangle("P", qp.nz)), "P_before": ("cost", _triangle("P", qp.nz)),
        "slope": ("slope", z), "slope_before": ("slope", z),
        "z": ("change", z), "z_after": ("change", z),
        "bounds": ("bound", [f"{n}_{e}" for e in ("lo", "hi", "rate") for n in controls]),
        "target": ("target", ["mean", "ease"]),
    }  # fmt: skip
    at_end = common | {"column": ("end", end), "s": ("end_status", rows), "status": (
        "end_status", rows)}  # fmt: skip
    on_way = common | {"column": ("stage", stage), "s": ("status", [*controls, *rows])}
    on_way["statuses"] = on_way["s"]
    weighed = on_way | {"column": ("rows", stage[A + B + h.nx :])}
    by_function: dict[str, Mapping[str, tuple[str, Sequence[str]]]] = dict.fromkeys(
        ("motion", "motion_once", "stage", "stage_step", "qp_backward", "qp_forward", "ip_backward",
         "ip_forward", "ip_excess", "ip_begin", "slopes"), on_way)  # fmt: skip
    by_function |= dict.fromkeys(("rows", "rows_once"), weighed)
    by_function |= dict.fromkeys(("end", "qp_end", "qp_last", "ip_end", "ip_last"), at_end)
    gains = {"gains": ("gain", [*gain, *cross, *inner, *_many("qv", h.nu)])}
    for name in ("qp_backward", "qp_forward", "ip_backward", "ip_forward"):
        by_function[name] = {**by_function[name], **gains}
    parts = ("X", "U", "status", "mark", "open", "residual", "over", "passes")
    starts = [sum(qp.sizes[:k]) for k in range(len(qp.sizes))]
    found = {starts[k]: n for k, n in enumerate(parts)}
    whole = {"z": ("found", found), "z_next": ("found", found)}
    return {
        **{f: {a: (g, dict(enumerate(n))) for a, (g, n) in named.items()}
           for f, named in by_function.items()},
        **dict.fromkeys(("qp_pass", "qp_go_on"), whole),
    }  # fmt: skip


def _short(names: Iterable[str]) -> list[str]:
    """Names without those of their parts, where they stay apart."""
    full = [n.replace(".", "_") for n in names]
    last = [n.rpartition(".")[2] if not n.rpartition(".")[2].isdecimal() else n.replace(".", "_")
            for n in names]  # fmt: skip
    return last if len(set(last)) == len(last) else full


def _many(name: str, count: int) -> list[str]:
    return [f"{name}_{i}" for i in range(count)]


def _triangle(name: str, n: int) -> list[str]:
    return [f"{name}_{i}_{j}" for j in range(n) for i in range(j + 1)]


def _pieces(layout: Layout, names: Sequence[str]) -> list[str]:
    """Name of each number of a packed column: the piece, row and column."""
    found = []
    for name, s in zip(names, layout.sparsity, strict=True):
        for i, j in zip(*s.get_triplet(), strict=True):
            found.append(f"{name}_{i}" if s.is_column() else f"{name}_{i}_{j}")
    return found


def _constants(h: Horizon) -> list[str]:
    """Parameters, weights, four of each limit, the damping."""
    ends = ("min", "max", "weight", "linear")
    return [
        *_short(elements(h.model, "param")), *(f"weight_{n}" for n in _short(h.weighed)),
        *(f"{n}_{e}" for n in _short(h.soft) for e in ends), *["damping"] * h.damped,
    ]  # fmt: skip
