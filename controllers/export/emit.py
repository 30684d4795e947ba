"""C99 text of a CasADi function of scalars: one plain function with named arrays, no workspace, no CasADi run time.

CasADi's own generator wraps every function in pointer tables, workspaces and query functions, which an embedded
compiler at its strictest warns about and a reader has to look past. The instruction list that CasADi exposes is all
that is needed for functions of ``SX``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from pneuid.errors import ComputationError

_CALLS = {
    ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_SQRT: "sqrt", ca.OP_SIN: "sin",
    ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan", ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh", ca.OP_TANH: "tanh", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil", ca.OP_FABS: "fabs",
    ca.OP_EXPM1: "expm1", ca.OP_LOG1P: "log1p", ca.OP_HYPOT: "hypot", ca.OP_ATAN2: "atan2",
    ca.OP_FMIN: "smaller", ca.OP_FMAX: "larger", ca.OP_SIGN: "sign",
}  # fmt: skip

_FORMS = {
    ca.OP_ASSIGN: "{0}", ca.OP_ADD: "{0} + {1}", ca.OP_SUB: "{0} - {1}", ca.OP_MUL: "{0} * {1}", ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}", ca.OP_SQ: "{0} * {0}", ca.OP_TWICE: "2.0 * {0}", ca.OP_INV: "1.0 / {0}", ca.OP_LT: "{0} < {1}",
    ca.OP_LE: "{0} <= {1}", ca.OP_EQ: "{0} == {1}", ca.OP_NE: "{0} != {1}", ca.OP_NOT: "{0} == 0.0",
    ca.OP_AND: "{0} != 0.0 && {1} != 0.0", ca.OP_OR: "{0} != 0.0 || {1} != 0.0",
    ca.OP_IF_ELSE_ZERO: "{0} != 0.0 ? {1} : 0.0",
}  # fmt: skip


def declaration(function: ca.Function, name: str, arguments: Sequence[str], results: Sequence[str]) -> str:
    """``void name(const double a[2], ..., double r[3])``, without the semicolon; empty arguments are left out."""
    given = [f"const double {a}[{function.numel_in(i)}]" for i, a in enumerate(arguments) if function.numel_in(i)]
    found = [f"double {r}[{function.numel_out(i)}]" for i, r in enumerate(results)]
    return f"void {name}({', '.join([*given, *found])})"


def definition(function: ca.Function, name: str, arguments: Sequence[str], results: Sequence[str]) -> str:
    """The function's C text. Matrices are stored by columns, as CasADi does.

    Raises ``ComputationError`` for an operation that has no C99 form here, and ``ValueError`` unless the function is
    one of ``SX`` with dense arguments and results.
    """
    dense = [function.sparsity_in(i).is_dense() for i in range(function.n_in())]
    dense += [function.sparsity_out(i).is_dense() for i in range(function.n_out())]
    if not (function.is_a("SXFunction") and all(dense)):
        raise ValueError(f"{function.name()} must be a function of SX with dense arguments and results")
    lines, last = [], -1
    for k in range(function.n_instructions()):
        place, text = _instruction(function, k, arguments, results)
        last = max(last, place)
        lines.append(f"    {text};")
    text = "\n".join(lines)
    unused = [a for i, a in enumerate(arguments) if function.numel_in(i) and f" {a}[" not in text]
    opening = f"    double w[{last + 1}];\n\n" + "".join(f"    (void){name};\n" for name in unused)
    return f"{declaration(function, name, arguments, results)}\n{{\n{opening}{text}\n}}\n"


def _instruction(function: ca.Function, k: int, arguments: Sequence[str], results: Sequence[str]) -> tuple[int, str]:
    """Work place written (-1 for a result) and the statement of instruction ``k``."""
    operation = function.instruction_id(k)
    given, found = function.instruction_input(k), function.instruction_output(k)
    if operation == ca.OP_OUTPUT:
        return -1, f"{results[found[0]]}[{found[1]}] = w[{given[0]}]"
    place = found[0]
    if operation == ca.OP_CONST:
        value = number(function.instruction_constant(k))
    elif operation == ca.OP_INPUT:
        value = f"{arguments[given[0]]}[{given[1]}]"
    elif operation in _CALLS:
        value = f"{_CALLS[operation]}({', '.join(f'w[{i}]' for i in given)})"
    elif operation in _FORMS:
        value = _FORMS[operation].format(*(f"w[{i}]" for i in given))
    else:
        raise ComputationError(
            f"{function.name()} uses CasADi operation {operation}, which has no C form in the export"
        )
    return place, f"w[{place}] = {value}"


def number(value: float) -> str:
    """A C literal of type double that reads back as exactly ``value``; infinities are ``INFINITY``."""
    if value in (float("inf"), float("-inf")):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))


def array(name: str, values: Mapping[str, float] | Sequence[float], size: str) -> str:
    """A constant array; a mapping's keys become comments."""
    if isinstance(values, Mapping):
        rows = [f"    {number(value)}, /* {key} */" for key, value in values.items()]
    else:
        rows = [f"    {number(value)}," for value in values]
    return f"const double {name}[{size}] = {{\n" + "\n".join(rows) + "\n};\n"
