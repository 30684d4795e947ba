"""CasADi's functions written as C in which every number is a vector, one lane for each of several evaluations.

Operation by operation; what depends on one input alone, which stays the same while the others change, is computed apart. The
exponential is a polynomial after a reduction by powers of two (Muller, Elementary Functions, 3rd ed. (2016), section 11.2), to
2 units in the last place. Needs GCC's vector extensions, which clang has as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

HEAD = """
#include <math.h>
typedef double v __attribute__((vector_size(8 * LANES)));
typedef long long w __attribute__((vector_size(8 * LANES)));
/* not merged into the loops around it, where the compiler takes twice as long for it */
#define ALONE static __attribute__((noinline))
#define ALL(c) ((v){0} + (c))
#define BOTH(m, x) ((v)((w)(m) & (w)(x)))
static inline v pick(w m, v x, v y) { return (v)((m & (w)x) | (~m & (w)y)); }
static inline v absolute(v x) { return (v)((w)x & 0x7fffffffffffffffLL); }
static inline v signed_like(v x, v y) { return (v)(((w)x & 0x7fffffffffffffffLL) | ((w)y & ~0x7fffffffffffffffLL)); }
static inline v least(v x, v y) { return pick(x < y, x, y); }
static inline v most(v x, v y) { return pick(x > y, x, y); }
static inline v root(v x) { v r; for (int l = 0; l < LANES; l++) r[l] = __builtin_sqrt(x[l]); return r; }
#define EACH(name) static inline v each_##name(v x) { v r; for (int l = 0; l < LANES; l++) r[l] = name(x[l]); return r; }
#define EACH2(name) static inline v each_##name(v x, v y) { \\
  v r; for (int l = 0; l < LANES; l++) r[l] = name(x[l], y[l]); return r; }
EACH(log) EACH(log1p) EACH(sin) EACH(cos) EACH(tan) EACH(asin) EACH(acos) EACH(atan) EACH(sinh) EACH(cosh) EACH(tanh)
EACH(floor) EACH(ceil) EACH(erf) EACH2(pow) EACH2(fmod) EACH2(atan2) EACH2(hypot)
/* 2^k - 1 and 2^k times the polynomial of expm1 on half of ln 2 to either side */
static inline v parts_of_exponential(v x, v *power) {
  const double shift = 0x1.8p52;
  x = pick(x < -700.0, ALL(-700.0), pick(x > 709.0, ALL(709.0), x));
  v t = x * 0x1.71547652b82fep0 + shift, k = t - shift;
  v r = (x - k * 0x1.62e42fefa39efp-1) - k * 0x1.abc9e3b39803fp-56;
  v p = ALL(1.0 / 6227020800.0);
  p = p * r + 1.0 / 479001600.0; p = p * r + 1.0 / 39916800.0; p = p * r + 1.0 / 3628800.0; p = p * r + 1.0 / 362880.0;
  p = p * r + 1.0 / 40320.0; p = p * r + 1.0 / 5040.0; p = p * r + 1.0 / 720.0; p = p * r + 1.0 / 120.0;
  p = p * r + 1.0 / 24.0; p = p * r + 1.0 / 6.0; p = p * r + 0.5;
  *power = (v)(((w)t << 52) + 0x3ff0000000000000LL);
  return *power * (r + r * r * p);
}
static inline v expm1_of(v x) { v s, p = parts_of_exponential(x, &s); return p + (s - 1.0); }
static inline v exp_of(v x) { v s, p = parts_of_exponential(x, &s); return p + s; }
static inline long smaller(long i, long j) { return i < j ? i : j; }
static inline void copied(v *to, const v *from, int n) { for (int i = 0; i < n; i++) to[i] = from[i]; }
static inline void into_lanes(v *to, const double *from, long n, const long *at) {
  for (long l = 0; l < LANES; l++) for (long j = 0; j < n; j++) to[j][l] = from[at[l] * n + j];
}
static inline void out_of_lanes(double *to, const v *from, long n, const long *at, long k, const long *length) {
  for (long l = 0; l < LANES; l++) if (k < length[l]) for (long j = 0; j < n; j++) to[at[l] * n + j] = from[j][l];
}
"""

OPERATIONS = {
    ca.OP_ASSIGN: "{0}", ca.OP_ADD: "{0} + {1}", ca.OP_SUB: "{0} - {1}", ca.OP_MUL: "{0} * {1}", ca.OP_NEG: "-{0}",
    ca.OP_EXP: "exp_of({0})", ca.OP_EXPM1: "expm1_of({0})", ca.OP_LOG: "each_log({0})", ca.OP_LOG1P: "each_log1p({0})",
    ca.OP_POW: "each_pow({0}, {1})", ca.OP_CONSTPOW: "each_pow({0}, {1})", ca.OP_SQRT: "root({0})", ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}", ca.OP_SIN: "each_sin({0})", ca.OP_COS: "each_cos({0})", ca.OP_TAN: "each_tan({0})",
    ca.OP_ASIN: "each_asin({0})", ca.OP_ACOS: "each_acos({0})", ca.OP_ATAN: "each_atan({0})", ca.OP_SINH: "each_sinh({0})",
    ca.OP_COSH: "each_cosh({0})", ca.OP_TANH: "each_tanh({0})", ca.OP_ERF: "each_erf({0})", ca.OP_FLOOR: "each_floor({0})",
    ca.OP_CEIL: "each_ceil({0})", ca.OP_FMOD: "each_fmod({0}, {1})", ca.OP_ATAN2: "each_atan2({0}, {1})",
    ca.OP_HYPOT: "each_hypot({0}, {1})", ca.OP_FABS: "absolute({0})", ca.OP_COPYSIGN: "signed_like({0}, {1})",
    ca.OP_SIGN: "BOTH({0} > 0.0, ALL(1.0)) - BOTH({0} < 0.0, ALL(1.0))", ca.OP_FMIN: "least({0}, {1})",
    ca.OP_FMAX: "most({0}, {1})", ca.OP_INV: "1.0 / {0}",
}  # fmt: skip
_COMPARISONS = {ca.OP_LT: "{0} < {1}", ca.OP_LE: "{0} <= {1}", ca.OP_EQ: "{0} == {1}", ca.OP_NE: "{0} != {1}"}
_LOGIC = {ca.OP_NOT: "~{0}", ca.OP_AND: "{0} & {1}", ca.OP_OR: "{0} | {1}"}


class NoLanesError(Exception):
    """A function holds an operation that is not written for lanes."""


class Written:
    """A C function of dense vectors ``NAME(i0, i1, ..., constant, o0, ...)`` and one that fills ``constant`` beforehand.

    constants : how many values depend on the input number ``still`` alone, which stays the same over an interval; they
    are computed once by ``NAME_before(i, constant)``. Raises ``NoLanesError``.
    """

    def __init__(self, function: ca.Function, name: str, still: int) -> None:
        self.name, self.constants = name, 0
        self._before: list[str] = []
        self._lines: list[str] = []
        self._fixed: dict[str, str] = {}
        self._known: dict[str, str] = {}
        held: dict[int, str] = {}
        for k in range(function.n_instructions()):
            op, to, of = function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
            if op == ca.OP_OUTPUT:
                number = self._number(held[of[0]])
                self._fetched(number)
                self._lines.append(f"o{to[0]}[{to[1]}] = {number};")
            elif op == ca.OP_CONST:
                held[to[0]] = self._value(f"ALL({function.instruction_constant(k)!r})", ())
            elif op == ca.OP_INPUT:
                place = f"i{of[0]}[{of[1]}]"
                held[to[0]] = self._value(place, () if of[0] == still else ("",))
            else:
                held[to[0]] = self._made(op, [held[j] for j in of], function.name())
        inputs = "".join(f"const v *restrict i{i}, " for i in range(function.n_in()))
        outputs = "".join(f", v *restrict o{i}" for i in range(function.n_out()))
        self.text = (
            f"static void {name}_before(const v *restrict i{still}, v *restrict constant) {{\n" + "\n".join(self._before)
            + f"\n}}\nALONE void {name}({inputs}const v *restrict constant{outputs}) {{\n" + "\n".join(self._lines) + "\n}\n"
        )  # fmt: skip

    def _made(self, op: int, of: Sequence[str], name: str) -> str:
        if op in _LOGIC:
            truths = [self._truth(one) for one in of]
            return self._value(_LOGIC[op].format(*truths), truths, "m")
        if op == ca.OP_IF_ELSE_ZERO:
            both = self._truth(of[0]), self._number(of[1])
            return self._value("BOTH({}, {})".format(*both), both)
        numbers = [self._number(one) for one in of]
        if op in _COMPARISONS:
            return self._value(_COMPARISONS[op].format(*numbers), numbers, "m")
        if op == ca.OP_DIV:  # what is divided by often is inverted once
            numbers[1], op = self._value(f"1.0 / {numbers[1]}", numbers[1:]), ca.OP_MUL
        if op not in OPERATIONS:
            raise NoLanesError(f"{name}: operation {op}")
        return self._value(OPERATIONS[op].format(*numbers), numbers)

    def _number(self, one: str) -> str:
        """A value as a number: 1 or 0 where it is true or not."""
        return one if one[0] == "a" else self._value(f"BOTH({one}, ALL(1.0))", (one,))

    def _truth(self, one: str) -> str:
        return one if one[0] == "m" else self._value(f"({one} != 0.0)", (one,), "m")

    def _value(self, text: str, of: Sequence[str], kind: str = "a") -> str:
        """The name of what ``text`` computes of other values, once each."""
        if text in self._known:
            return self._known[text]
        name = f"{kind}{len(self._known)}"
        self._known[text] = name
        line = f"const {'v' if kind == 'a' else 'w'} {name} = {text};"
        if all(one in self._fixed for one in of):
            self._fixed[name] = text
            self._before.append(line)
        else:
            for one in of:
                self._fetched(one)
            self._lines.append(line)
        return name

    def _fetched(self, one: str) -> None:
        """Have a value that was computed before where the others are."""
        if one not in self._fixed or not self._fixed[one]:
            return
        text, self._fixed[one] = self._fixed[one], ""
        if text.startswith("ALL("):
            self._lines.append(f"const v {one} = {text};")
            return
        kind = "v" if one[0] == "a" else "w"
        self._before.append(f"constant[{self.constants}] = (v){one};")
        self._lines.append(f"const {kind} {one} = ({kind})constant[{self.constants}];")
        self.constants += 1
