"""The compiled interval function: K samples forward with sensitivities and Gauss-Newton blocks.

One interval starts at a node state ``s`` and runs over ``K`` samples. At each sample the weighted residual
``r = weight * (output - measured)`` and its derivative with respect to ``[theta selected, s]`` are accumulated in a packed
Gram matrix of ``[theta selected, s, 1]``; the state and its sensitivity are then stepped to the next sample. So one call
gives all that a Gauss-Newton solver needs: end state, its derivative, cost, gradient and Hessian block.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from pneuid.compiled import compile_functions
from pneuid.lanes import Body, begin_side_by_side, side_by_side
from pneuid.mapped import pair
from pneuid.plant import Plant, once_per_structure
from pneuid.step import STRUCTURES, substep

PREFIX = "pneuid"


@dataclass(frozen=True)
class IntervalFunction:
    """Compiled evaluation of intervals of ``samples`` samples each.

    values : ``(s, data, theta) -> (end, cost)``; derivatives : ``(s, data, theta) -> (end, sensitivity, gram)``;
    trajectory : ``(s, data, theta) -> outputs (ny x K), states (ns x K+1)``. ``data`` is ``(rows, K)`` with rows
    ``dt``, inputs, input slopes, measured, weights. ``sensitivity`` is ``ns x (np + ns)``, ``gram`` the packed upper
    triangle (column order) of the ``np + ns + 1`` square.
    """

    values: ca.Function
    derivatives: ca.Function
    trajectory: ca.Function
    samples: int
    substeps: int
    selected: tuple[str, ...]
    compiled: bool

    @property
    def width(self) -> int:
        """Number of derivative columns, ``np + ns``."""
        return int(self.derivatives.size2_out(1))


def data_rows(plant: Plant) -> int:
    """Rows of one sample's data column."""
    return 1 + 2 * len(plant.inputs) + 2 * len(plant.outputs)


def _symbols(plant: Plant) -> tuple[ca.SX, ca.SX, ca.SX]:
    return (
        ca.SX.sym("s", len(plant.states)),
        ca.SX.sym("d", data_rows(plant)),
        ca.SX.sym("theta", len(plant.theta_names)),
    )


def _split(plant: Plant, d: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
    nw, ny = len(plant.inputs), len(plant.outputs)
    ends = [0, 1, 1 + nw, 1 + 2 * nw, 1 + 2 * nw + ny, 1 + 2 * nw + 2 * ny]
    dt, w, slope, y, weight = ca.vertsplit(d, ends)
    return dt, w, slope, y, weight


class _Symbols:
    """State, sample, parameters and step of one sample, and the functions of these that a chain calls by name."""

    def __init__(self, plant: Plant) -> None:
        self.s, self.d, self.theta = _symbols(plant)
        dt, w, slope, y, weight = _split(plant, self.d)
        outputs = plant.evaluate(self.s, w, self.theta).outputs
        self.shown = ca.vertcat(*(outputs[name] for name in plant.outputs))
        self.residual = weight * (self.shown - y)
        self.fraction, self.h = ca.SX.sym("fraction"), ca.SX.sym("h")
        self.moved = substep(plant, self.s, w + self.fraction * dt * slope, slope, self.h, self.theta)

    def function(self, name: str, given: Mapping[str, ca.SX], result: Sequence[ca.SX]) -> ca.Function:
        """A function of ``given``, the sample and the parameters."""
        given = {**given, "d": self.d, "theta": self.theta}
        expressions = ca.cse([ca.densify(item) for item in result])
        return ca.Function(f"{PREFIX}_{name}", [*given.values()], expressions, [*given], [f"r{i}" for i in range(len(result))])


@once_per_structure(STRUCTURES)
def _symbols_of(plant: Plant) -> _Symbols:
    return _Symbols(plant)


@once_per_structure(STRUCTURES)
def _plain_parts(plant: Plant) -> dict[str, ca.Function]:
    """SX building blocks of one sample without derivatives: outputs, cost and a step of ``h`` seconds."""
    at, cost = _symbols_of(plant), ca.SX.sym("cost")
    return {
        "output": at.function("output", {"s": at.s}, [at.shown]),
        "cost": at.function("cost", {"s": at.s, "cost": cost}, [cost + ca.dot(at.residual, at.residual)]),
        "step": at.function("step", {"s": at.s, "fraction": at.fraction, "h": at.h}, [at.moved]),
    }


@once_per_structure(STRUCTURES)
def _slope_parts(plant: Plant, selected: tuple[str, ...]) -> dict[str, ca.Function]:
    """The same with derivatives by the ``selected`` parameters and the first state."""
    at = _symbols_of(plant)
    index = [plant.theta_names.index(name) for name in selected]
    ns, np_ = len(plant.states), len(index)
    chosen = at.theta[index] if index else ca.SX(0, 1)
    S = ca.SX.sym("S", ns, np_ + ns)
    A, B = ca.jacobian(at.moved, at.s), ca.jacobian(at.moved, chosen)
    S_next = A @ S + ca.horzcat(B, ca.SX(ns, ns))
    H, Hp = ca.jacobian(at.residual, at.s), ca.jacobian(at.residual, chosen)
    rows = ca.horzcat(H @ S + ca.horzcat(Hp, ca.SX(len(plant.outputs), ns)), at.residual)
    gram = ca.SX.sym("G", (np_ + ns + 1) * (np_ + ns + 2) // 2)
    full = ca.densify(rows).T @ ca.densify(rows)
    packed = ca.vertcat(*(full[: j + 1, j] for j in range(np_ + ns + 1)))
    both = {"s": at.s, "S": S}
    return {
        "gram": at.function("gram", {**both, "gram": gram}, [gram + packed]),
        "weighted": at.function("weighted", both, [rows]),
        "rows": at.function("rows", both, [rows[:, : np_ + ns]]),
        "move": at.function("move", {**both, "fraction": at.fraction, "h": at.h}, [at.moved, S_next]),
    }


def _part(plant: Plant, selected: Sequence[str], name: str) -> ca.Function:
    """A building block of one sample by name."""
    plain = _plain_parts(plant)
    return plain[name] if name in plain else _slope_parts(plant, tuple(selected))[name]


def _chains(plant: Plant, selected: Sequence[str], samples: int, substeps: int) -> dict[str, Callable[[], ca.Function]]:
    """Makers of the MX interval functions: the sample functions called in a row; generated code stays a list of calls."""
    ns, width = len(plant.states), len(selected) + len(plant.states)
    start = ca.MX.sym("s", ns)
    data = ca.MX.sym("data", data_rows(plant), samples)
    theta = ca.MX.sym("theta", len(plant.theta_names))
    given, columns = [start, data, theta], ca.horzsplit(data)
    part = partial(_part, plant, selected)

    def sampled(name: str) -> ca.Function:
        """What the substeps of one sample make of the state, in a row."""
        one = part(name)
        state, column, at = one.mx_in()[:-4], ca.MX.sym("d", data.size1()), ca.MX.sym("theta", theta.numel())
        after = state
        for j in range(substeps):
            after = one.call([*after, j / substeps, column[0] / substeps, column, at])
        return ca.Function(f"{one.name()}_sampled", [*state, column, at], after)

    def values() -> ca.Function:
        add, step, s, cost = part("cost"), sampled("step"), start, ca.MX(1, 1)
        for column in columns:
            cost = add(s, cost, column, theta)
            s = step(s, column, theta)
        return ca.Function(f"{PREFIX}_values", given, [s, cost])

    def trajectory() -> ca.Function:
        output, step, outputs, states = part("output"), sampled("step"), [], [start]
        for column in columns:
            outputs.append(output(states[-1], column, theta))
            states.append(step(states[-1], column, theta))
        return ca.Function(f"{PREFIX}_trajectory", given, [ca.horzcat(*outputs), ca.horzcat(*states)])

    def derivatives() -> ca.Function:
        add, move, s, S = part("gram"), sampled("move"), start, _unmoved(ns, width)
        gram = ca.MX(ca.DM.zeros((width + 1) * (width + 2) // 2, 1))
        for column in columns:
            gram = add(s, S, gram, column, theta)
            s, S = move(s, S, column, theta)
        return ca.Function(f"{PREFIX}_derivatives", given, [s, S, gram])

    def jacobian() -> ca.Function:
        weighted, move, s, S, rows = part("rows"), sampled("move"), start, _unmoved(ns, width), []
        for column in columns:
            rows.append(weighted(s, S, column, theta))
            s, S = move(s, S, column, theta)
        return ca.Function(f"{PREFIX}_jacobian", given, [ca.vertcat(*rows), S])

    return {"values": values, "trajectory": trajectory, "derivatives": derivatives, "jacobian": jacobian}


def _bodies(plant: Plant, selected: Sequence[str], samples: int) -> dict[str, Body]:
    """The same chains as C over lanes, with loops for samples and for as many substeps as the caller asks for."""
    ns, ny, rows, width = len(plant.states), len(plant.outputs), data_rows(plant), len(selected) + len(plant.states)
    packed = (width + 1) * (width + 2) // 2
    given = {"start": ns, "data": rows * samples, "theta": len(plant.theta_names)}
    begin = f"v s[{ns}], moved[{ns}]; copied(s, start, {ns});"
    slopes = (
        f"v S[{ns * width}], turned[{ns * width}]; for (int i = 0; i < {ns * width}; i++) S[i] = ALL(0.0);\n"
        f"for (int i = 0; i < {ns}; i++) S[{ns} * ({width - ns} + i) + i] = ALL(1.0);"
    )
    each = f"for (int k = 0; k < {samples}; k++) {{ const v *d = data + k * {rows};"
    inner = "for (long j = 0; j < substeps; j++) { v h[1] = {*d / (double)substeps}, fraction[1] = {ALL(j / (double)substeps)};"
    step = f"{inner} step(s, fraction, h, d, theta, step_constant, moved); copied(s, moved, {ns}); }}"
    move = (
        f"{inner} move(s, S, fraction, h, d, theta, move_constant, moved, turned);\n"
        f"copied(s, moved, {ns}); copied(S, turned, {ns * width}); }}"
    )
    ends = f"copied(end_, s, {ns});"
    gram = (
        f"v R[{ny * (width + 1)}]; weighted(s, S, d, theta, weighted_constant, R); v *g = gram_;\n"
        f"for (int b = 0; b < {width + 1}; b++) for (int a = 0; a <= b; a++, g++) {{ v sum = *g;\n"
        f"for (int i = 0; i < {ny}; i++) sum += R[{ny} * a + i] * R[{ny} * b + i]; *g = sum; }}"
    )
    texts = {
        "values": (
            ("cost", "step"),
            [begin, "v sum[1] = {ALL(0.0)};", each, "cost(s, sum, d, theta, cost_constant, cost_); *sum = *cost_;", step, "}",
             ends],
            {"end": ns, "cost": 1},
        ),
        "trajectory": (
            ("output", "step"),
            [begin, f"copied(states_, s, {ns});", each, f"output(s, d, theta, output_constant, outputs_ + k * {ny});", step,
             f"copied(states_ + (k + 1) * {ns}, s, {ns}); }}"],
            {"outputs": ny * samples, "states": ns * (samples + 1)},
        ),
        "derivatives": (
            ("weighted", "move"),
            [begin, each, gram, move, "}", ends, f"copied(slopes_, S, {ns * width});"],
            {"end": ns, "slopes": ns * width, "gram": packed},
        ),
        "jacobian": (
            ("rows", "move"),
            [begin, each, f"v R[{ny * width}]; rows(s, S, d, theta, rows_constant, R);",
             f"for (int j = 0; j < {width}; j++) copied(rows_ + (j * {samples} + k) * {ny}, R + j * {ny}, {ny});", move, "}",
             f"copied(slopes_, S, {ns * width});"],
            {"rows": ny * samples * width, "slopes": ns * width},
        ),
    }  # fmt: skip
    # slopes and what is summed up with them belong to a window, so that they are those by its first state
    first = {"derivatives": f"{slopes} for (int i = 0; i < {packed}; i++) gram_[i] = ALL(0.0);", "jacobian": slopes}
    then = f"copied(start, s, {ns});"
    return {
        name: Body("\n".join(lines), parts, given, found, first.get(name, ""), then)
        for name, (parts, lines, found) in texts.items()
    }


def _unmoved(ns: int, width: int) -> ca.MX:
    """Sensitivity of the start state by parameters and itself."""
    return ca.MX(ca.DM(np.hstack([np.zeros((ns, width - ns)), np.eye(ns)])))


_USUAL = ("values", "derivatives", "trajectory")


@once_per_structure(64)
def _build(plant: Plant, selected: tuple[str, ...], samples: int, substeps: int) -> IntervalFunction:
    (values, derivatives, trajectory), done = _compiled(plant, selected, samples, substeps, _USUAL)
    return IntervalFunction(values, derivatives, trajectory, samples, substeps, selected, done)


@once_per_structure(128)
def _single(plant: Plant, selected: tuple[str, ...], samples: int, substeps: int, name: str) -> ca.Function:
    (function,), _ = _compiled(plant, selected, samples, substeps, (name,))
    return function


def _compiled(
    plant: Plant, selected: Sequence[str], samples: int, substeps: int, names: Sequence[str]
) -> tuple[list[ca.Function], bool]:
    """The chains of these names, each with a twin that runs them side by side, and whether they are compiled.

    Where there are twins the chains themselves stay as they are: they say what the twins give, and nothing runs them.
    """
    chains = _chains(plant, selected, samples, substeps)
    twins = side_by_side(*_in_lanes(plant, selected, samples, names), substeps, PREFIX)
    made = [chains[name]() for name in names]
    if not twins:
        return compile_functions(made, PREFIX)
    for name, chain in zip(names, made, strict=True):
        pair(chain, twins[name])
    return made, True


def _in_lanes(
    plant: Plant, selected: Sequence[str], samples: int, names: Sequence[str]
) -> tuple[dict[str, ca.Function], dict[str, Body]]:
    """The sample's functions that the chains of these names need, and the bodies of those."""
    every = _bodies(plant, selected, samples)
    bodies = {name: every[name] for name in names}
    return {part: _part(plant, selected, part) for body in bodies.values() for part in body.parts}, bodies


@once_per_structure(128)
def begin(plant: Plant, selected: tuple[str, ...], samples: int, names: tuple[str, ...] = _USUAL) -> None:
    """Start compiling what the functions ``names`` of a plant will need, beside what else is done, whatever their substeps."""
    begin_side_by_side(*_in_lanes(plant, selected, samples, names), PREFIX)


def interval_function(plant: Plant, selected: Sequence[str], samples: int, substeps: int) -> IntervalFunction:
    """The interval function of ``plant`` with derivatives for the ``selected`` parameters; built once per process."""
    return _build(plant, tuple(selected), samples, substeps)


def trajectory_function(plant: Plant, samples: int, substeps: int) -> ca.Function:
    """``IntervalFunction.trajectory`` alone, which compiles in a fraction of the time."""
    return _single(plant, (), samples, substeps, "trajectory")


def jacobian_function(plant: Plant, selected: Sequence[str], samples: int, substeps: int) -> ca.Function:
    """``(s, data, theta) -> (rows, sensitivity)``: derivatives of the weighted outputs, ``(ny * K) x (np + ns)``, sample
    by sample, and of the end state, ``ns x (np + ns)``, with respect to ``[theta selected, s]``."""
    return _single(plant, tuple(selected), samples, substeps, "jacobian")
