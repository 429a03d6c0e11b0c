"""Small functions of C that expressions call."""

from __future__ import annotations

from collections.abc import Collection

from slipctl.ccode.tree.nodes import Node
from slipctl.ccode.tree.parser import code

HELPERS = {
    "square": "static double square(double x)\n{\n    return x * x;\n}\n",
    "lesser": (
        "static double lesser(double x, double y)\n{\n"
        "    return ((y < x) || (x != x)) ? y : x; /* as fmin */\n}\n"
    ),
    "greater": (
        "static double greater(double x, double y)\n{\n"
        "    return ((y > x) || (x != x)) ? y : x; /* as fmax */\n}\n"
    ),
    "below": (
        "static double below(double x, double bound)\n{\n"
        "    return (x < bound) ? x : bound; /* NaN: bound */\n}\n"
    ),
    "above": (
        "static double above(double x, double bound)\n{\n"
        "    return (x > bound) ? x : bound; /* NaN: bound */\n}\n"
    ),
    "at_most": (
        "static double at_most(double x, double bound)\n{\n"
        "    return (x <= bound) ? x : bound;\n}\n"
    ),
    "at_least": (
        "static double at_least(double x, double bound)\n{\n"
        "    return (x >= bound) ? x : bound;\n}\n"
    ),
    "slope_of_lesser": (
        "/* derivative of the smaller of x and y by x: 1 or 0, and half where they are equal */\n"
        "static double slope_of_lesser(double x, double y)\n{\n"
        "    return ((x <= y) ? 1.0 : 0.0) / (((y <= x) ? 1.0 : 0.0) + ((x <= y) ? 1.0 : 0.0));\n"
        "}\n"
    ),
    "element": (
        "/* the element that a number names by its whole part; NaN beyond the ends */\n"
        "static double element(const double *x, int n, double at)\n{\n"
        "    return ((at > -1.0) && (at < (double)n)) ? x[(int)at] : (double)NAN;\n}\n"
    ),
    "matrix_product": (
        "/* z = x y, of matrices in columns */\n"
        "static void matrix_product(const double *x, int rows, int inner, const double *y,\n"
        "                           int columns, double *z)\n{\n"
        "    for (int i = 0; i < columns; ++i) {\n        for (int j = 0; j < rows; ++j) {\n"
        "            z[j + i * rows] = 0.0;\n            for (int k = 0; k < inner; ++k) {\n"
        "                z[j + i * rows] += x[j + k * rows] * y[k + i * inner];\n"
        "            }\n        }\n    }\n}\n"
    ),
    "add_matrix_product": (
        "/* z = z + x y, of matrices in columns */\n"
        "static void add_matrix_product(const double *x, int rows, int inner, const double *y,\n"
        "                               int columns, double *z)\n{\n"
        "    for (int i = 0; i < columns; ++i) {\n        for (int j = 0; j < rows; ++j) {\n"
        "            for (int k = 0; k < inner; ++k) {\n"
        "                z[j + i * rows] += x[j + k * rows] * y[k + i * inner];\n"
        "            }\n        }\n    }\n}\n"
    ),
    "add_sparse_product": (
        "/* z = z + x y: numbers of x column by column, which begin there, in these rows */\n"
        "static void add_sparse_product(const double *x, const int *begin, const int *row,\n"
        "                               int columns, const double *y, double *z)\n{\n"
        "    for (int i = 0; i < columns; ++i) {\n"
        "        for (int k = begin[i]; k < begin[i + 1]; ++k) {\n"
        "            z[row[k]] += x[k] * y[i];\n"
        "        }\n    }\n}\n"
    ),
    "reached": (
        "/* last of n rising places that x has reached; the first if none, or if x is NaN */\n"
        "static int reached(const double *at, int n, double x)\n{\n"
        "    int low = 0;\n    int high = n;\n    while ((high - low) > 1) {\n"
        "        const int middle = (low + high) / 2;\n"
        "        if (x >= at[middle]) {\n            low = middle;\n        } else {\n"
        "            high = middle;\n        }\n    }\n    return low;\n}\n"
    ),
    "sign_of": (
        "static double sign_of(double x)\n{\n"
        "    return (x < 0.0) ? -1.0 : ((x > 0.0) ? 1.0 : x);\n}\n"
    ),
}
"""Functions that the expressions may call beside those of math.h."""


def helpers(names: Collection[str]) -> list[Node]:
    """Definitions of helper functions, in a fixed order."""
    return [n for name, text in HELPERS.items() if name in names for n in code(text)]
