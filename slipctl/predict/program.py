"""A nonlinear program in the making: what is varied and what is kept, each with its limits."""

from __future__ import annotations

from typing import Any

import casadi as ca


class Program:
    """Variables and rows of a program, in their order; limits are numbers or expressions.

    Attributes:
        variables: symbols. equations: for each element of the rows, whether it says that two are
            equal, as FATROP wants to know.
    """

    def __init__(self) -> None:
        self.variables: list[Any] = []
        self.equations: list[bool] = []
        self._rows: list[Any] = []
        self._given: dict[str, list[Any]] = {k: [] for k in ("x0", "lbx", "ubx", "lbg", "ubg")}

    def vary(self, symbol: Any, start: Any, least: Any, most: Any) -> Any:
        """Add a variable, its guess and its limits."""
        self.variables.append(symbol)
        self._add(x0=start, lbx=least, ubx=most)
        return symbol

    def keep(self, row: Any, least: Any, most: Any, equation: bool = False) -> None:
        """Add a row and its limits."""
        self._rows.append(row)
        self._add(lbg=least, ubg=most)
        self.equations += [equation] * row.numel()

    def equal(self, row: Any) -> None:
        """Add a row that has to be zero."""
        self.keep(row, ca.DM.zeros(row.numel()), ca.DM.zeros(row.numel()), equation=True)

    def _add(self, **columns: Any) -> None:
        for name, column in columns.items():
            self._given[name].append(column)

    @property
    def x(self) -> Any:
        """All variables, one below the other."""
        return ca.vertcat(*self.variables)

    @property
    def g(self) -> Any:
        """All rows, one below the other."""
        return ca.vertcat(*self._rows)

    @property
    def given(self) -> dict[str, Any]:
        """Guess and limits, as ``nlpsol`` calls them."""
        return {name: ca.vertcat(*columns) for name, columns in self._given.items()}
