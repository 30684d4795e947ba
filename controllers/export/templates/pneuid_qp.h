/* A quadratic program with the structure of optimal control, by a Riccati interior-point method.
 *
 *   minimise   sum_i 1/2 x_i' Q_i x_i + q_i' x_i  +  sum_i 1/2 R u_i^2
 *   subject to x_0 given, x_i+1 = A_i x_i + B_i u_i + c_i,  lower_i <= x_i <= upper_i  (i >= 1)
 *
 * with one command u, diagonal Q, and infinite bounds where there are none. A bound on state j with give[j] > 0 is
 * soft: crossing it by s costs s^2 / (2 give[j]); with give[j] = 0 it is hard and must be reachable through u.
 * The sizes are fixed when compiling: PNEUID_STAGES and PNEUID_NX of pneuid_model.h.
 *
 * What the method finds is taken to the last digit by Newton steps on the bounds that it found active.
 *
 * Sources: Rao, Wright, Rawlings, J. Optim. Theory Appl. 99 (1998) 723 (structure); Mehrotra, SIAM J. Optim. 2 (1992)
 * 575 (predictor and corrector); Hintermueller, Ito, Kunisch, SIAM J. Optim. 13 (2003) 865 (active sets by Newton steps). */
#ifndef PNEUID_QP_H
#define PNEUID_QP_H

#include "pneuid_model.h"

#define PNEUID_QP_BOUNDS (2 * PNEUID_STAGES * PNEUID_NX)

/* One bound: at a stage on a state, +1 for an upper, -1 for a lower one. */
typedef struct {
    short stage, state, side;
} pneuid_qp_bound;

typedef struct {
    /* the program */
    double A[PNEUID_STAGES][PNEUID_NX][PNEUID_NX];
    double B[PNEUID_STAGES][PNEUID_NX], c[PNEUID_STAGES][PNEUID_NX];
    double Q[PNEUID_STAGES + 1][PNEUID_NX], q[PNEUID_STAGES + 1][PNEUID_NX], R;
    double lower[PNEUID_STAGES + 1][PNEUID_NX], upper[PNEUID_STAGES + 1][PNEUID_NX], give[PNEUID_NX];
    /* the solution; x[0] is given */
    double x[PNEUID_STAGES + 1][PNEUID_NX], u[PNEUID_STAGES];
    /* work */
    double gain[PNEUID_STAGES][PNEUID_NX], pivot[PNEUID_STAGES];
    double dx[PNEUID_STAGES + 1][PNEUID_NX], du[PNEUID_STAGES];
    double Qb[PNEUID_STAGES + 1][PNEUID_NX], gx[PNEUID_STAGES + 1][PNEUID_NX];
    pneuid_qp_bound bound[PNEUID_QP_BOUNDS];
    double slack[PNEUID_QP_BOUNDS], multiplier[PNEUID_QP_BOUNDS], violation[PNEUID_QP_BOUNDS];
    double aim[PNEUID_QP_BOUNDS], dslack[PNEUID_QP_BOUNDS], dmultiplier[PNEUID_QP_BOUNDS];
    double found_x[PNEUID_STAGES + 1][PNEUID_NX], found_u[PNEUID_STAGES];
    double pull[PNEUID_QP_BOUNDS]; /* multipliers of the active bounds */
    char active[PNEUID_QP_BOUNDS];
    int bounds;     /* how many of them there are */
    int iterations; /* of the interior-point method; 0 when no bound was active */
} pneuid_qp;

/* Solve it from x[0]. tolerance holds for complementarity, bounds and last step of the interior point alike, below it the
 * active bounds are tried as equations; scale the program to order one. Returns 1 when it is solved, 0 when the
 * iterations ran out (x and u then are the best found). */
int pneuid_qp_solve(pneuid_qp *qp, double tolerance);

#endif
