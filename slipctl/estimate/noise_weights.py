"""Sums of residuals over a window of samples, with white noise or with noise that echoes.

A quantity formed from increments, as an adhesion from those of a wheel speed, has the noise
n_k = w_k - echo w_{k-1}. What is too much in one sample is missing in the next. It is white in its
innovations, one sample after the other,

    u_k = y_k + q_{k-1} u_{k-1},    r_k = 1 + echo^2 - echo q_{k-1},    q_k = echo/r_k

with variance r_k sigma^2 and q = 0 before the first (Brockwell and Davis, Time Series, 1991,
section 5.2). At echo = 1 they are cumulated sums: the mean of k samples is known to about
sqrt(12) sigma/k^1.5, where white noise of the same size would leave sqrt(2) sigma/sqrt(k).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from slipctl.estimate.model import Model


def white_sums(model: Model, window: int) -> ca.Function:
    """Function (values, samples, weights, constants) -> (squares, JJ, Je) over the window."""
    size, known = model.output.size1_in(1), model.output.size1_in(2)
    values, sample = ca.MX.sym("values", model.n), ca.MX.sym("sample", size + 1)
    weight, constants = ca.MX.sym("weight"), ca.MX.sym("constants", known)
    y, row = model.output(values, sample[:size], constants)
    one = ca.Function(
        "one_sample", [values, sample, weight, constants],
        _products(model.n).call([sample[size] - y, row, weight]),
        ["values", "sample", "weight", "constants"], ["squares", "JJ", "Je"],
    )  # fmt: skip
    return one.map("all_samples", "serial", window, [0, 3], [0, 1, 2])


def _products(n: int) -> ca.Function:
    """Function (residual, regressor, weight) -> (squares, JJ, Je) of one sample."""
    e, row, weight = ca.SX.sym("e"), ca.SX.sym("row", 1, n), ca.SX.sym("weight")
    return ca.Function(
        "products", [e, row, weight], [weight * e**2, weight * row.T @ row, weight * row.T * e],
        ["e", "row", "weight"], ["squares", "JJ", "Je"], {"cse": True},
    )  # fmt: skip


def echoing_sums(model: Model, window: int, echo: float) -> tuple[ca.Function, ca.Function]:
    """The same sums of innovations, and what the next sample hears.

    The noise is the same in both directions of time. From the newest sample to the oldest it gives
    the sums, and as two outputs more JJ and Je of the oldest, given all others. From the oldest to
    the newest what echoes in the next residual, and in its regressor.
    """
    n = model.n
    (values, sample, weight, constants), e, row = _residual(model)
    sym: Any = ca.SX.sym if model.law.sx else ca.MX.sym
    size = 1 + n * n + n
    q, left, last, sums = sym("q"), sym("left", n + 1), sym("last", size), sym("sums", size)
    u = weight * (ca.vertcat(e, row.T) + left)
    r = 1 + echo**2 - echo * q
    more = ca.vertcat(u[0] ** 2, ca.vec(u[1:] @ u[1:].T), u[1:] * u[0]) / r
    one = ca.Function(
        "one_sample", [ca.vertcat(q, left, last, sums), values, sample, weight, constants],
        [ca.vertcat(weight * echo / r, echo / r * u, more, sums + more)], {"cse": True},
    )  # fmt: skip
    every = one.fold(window)
    taken = [
        ca.MX.sym("values", n), ca.MX.sym("samples", sample.shape[0], window),
        ca.MX.sym("weights", 1, window), ca.MX.sym("constants", constants.shape[0]),
    ]  # fmt: skip

    def end(*, newest_first: bool) -> list[ca.MX]:
        """(q, left, last, sums), the last two in parts."""
        p, samples, weights, known = taken
        order = slice(None, None, 1 if newest_first else -1)
        found = every(
            ca.DM.zeros(1 + (n + 1) + 2 * size), ca.repmat(p, 1, window), samples[:, order],
            weights[:, order], ca.repmat(known, 1, window),
        )  # fmt: skip
        lengths = [1, n + 1, *[1, n * n, n] * 2]
        return ca.vertsplit(found, [sum(lengths[:k]) for k in range(len(lengths) + 1)])

    _, _, _, JJ_last, Je_last, squares, JJ, Je = end(newest_first=True)
    JJ, JJ_last = (ca.reshape(m, n, n) for m in (JJ, JJ_last))
    found = ca.Function("all_samples", taken, [squares, JJ, Je, JJ_last, Je_last])
    return found, ca.Function("echo", taken, [end(newest_first=False)[1]])


def shift_ratios(shifts: ca.MX, memory: int, echo: float) -> ca.MX:
    """(sum of signature times shift)^2/sum of signature^2, of a shift 1, 2, ... samples ago.

    ``shifts`` are the latest innovations over their deviations, newest first. A shift leaves the
    :func:`signature` in them.
    """
    if not echo:
        return ca.cumsum(shifts.T) ** 2 / ca.DM(range(1, memory + 1))
    left = signature(memory, echo)
    columns = [left[k::-1] + [0.0] * (memory - 1 - k) for k in range(memory)]
    shapes = ca.sparsify(ca.DM(columns).T)
    return (shifts @ shapes).T ** 2 / ca.sum1(ca.densify(shapes) ** 2).T


def signature(latest: int, echo: float) -> list[float]:
    """What a shift of 1 leaves in the innovations from the first sample on: 1, 1 + echo, ..."""
    return [sum(echo**j for j in range(k + 1)) for k in range(latest)]


def _residual(model: Model) -> tuple[list[Any], Any, Any]:
    """Symbols (values, sample, weight, constants) of one sample, its residual and regressor."""
    size = model.output.size1_in(1)
    sym: Any = ca.SX.sym if model.law.sx else ca.MX.sym
    values, sample = sym("values", model.n), sym("sample", size + 1)
    weight, constants = sym("weight"), sym("constants", model.output.size1_in(2))
    y, row = model.output(values, sample[:size], constants)
    return [values, sample, weight, constants], sample[size] - y, row
