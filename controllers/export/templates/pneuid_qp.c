#include "pneuid_qp.h"

#include <string.h>

#include "pneuid_math.h"

#define N PNEUID_STAGES
#define NX PNEUID_NX

#define LARGEST_ITERATIONS 40
#define TO_BOUNDARY 0.995
#define FIRST_BARRIER 1.0
#define SMALLEST_SLACK 0.1
#define ENOUGH 1e-11 /* complementarity that is taken where no set of active bounds settles */
#define POLISHES 8  /* Newton steps at most on the active bounds */
#define YIELD 1e-8  /* softness of a hard bound in them; what it leaves is taken away by the next one */
#define EXACT 1e-10 /* largest change of the last step, and of a bound crossed that counts as none */

/* States under the commands u from x[0]. */
static void roll_out(pneuid_qp *qp)
{
    int i, a, b;
    for (i = 0; i < N; i++) {
        for (a = 0; a < NX; a++) {
            double total = qp->c[i][a] + qp->B[i][a] * qp->u[i];
            for (b = 0; b < NX; b++) {
                total += qp->A[i][a][b] * qp->x[i][b];
            }
            qp->x[i + 1][a] = total;
        }
    }
}

/* Riccati recursion for the weights Q: gain with u = -gain x, and the pivots. */
static void factorise(pneuid_qp *qp, const double Q[N + 1][NX])
{
    double P[NX][NX], PA[NX][NX], PB[NX];
    int i, a, b, k;

    memset(P, 0, sizeof P);
    for (a = 0; a < NX; a++) {
        P[a][a] = Q[N][a];
    }
    for (i = N - 1; i >= 0; i--) {
        const double(*A)[NX] = (const double(*)[NX])qp->A[i];
        const double *B = qp->B[i];
        double *gain = qp->gain[i];
        double h = qp->R;
        for (a = 0; a < NX; a++) {
            PB[a] = 0.0;
            for (b = 0; b < NX; b++) {
                double total = 0.0;
                PB[a] += P[a][b] * B[b];
                for (k = 0; k < NX; k++) {
                    total += P[a][k] * A[k][b];
                }
                PA[a][b] = total;
            }
            h += B[a] * PB[a];
        }
        qp->pivot[i] = h;
        for (a = 0; a < NX; a++) {
            double total = 0.0;
            for (k = 0; k < NX; k++) {
                total += A[k][a] * PB[k];
            }
            gain[a] = total / h;
        }
        for (a = 0; a < NX; a++) {
            for (b = a; b < NX; b++) {
                double total = -h * gain[a] * gain[b];
                for (k = 0; k < NX; k++) {
                    total += A[k][a] * PA[k][b];
                }
                P[a][b] = total;
                P[b][a] = total;
            }
            P[a][a] += Q[i][a];
        }
    }
}

/* Newton direction dx, du for the gradients gx and R u. */
static void direction(pneuid_qp *qp)
{
    double p[NX], new_p[NX];
    int i, a, k;

    memcpy(p, qp->gx[N], sizeof p);
    for (i = N - 1; i >= 0; i--) {
        double h = qp->R * qp->u[i];
        for (a = 0; a < NX; a++) {
            h += qp->B[i][a] * p[a];
        }
        qp->du[i] = h / qp->pivot[i];
        for (a = 0; a < NX; a++) {
            new_p[a] = qp->gx[i][a] - qp->gain[i][a] * h;
            for (k = 0; k < NX; k++) {
                new_p[a] += qp->A[i][k][a] * p[k];
            }
        }
        memcpy(p, new_p, sizeof p);
    }
    memset(qp->dx[0], 0, sizeof qp->dx[0]);
    for (i = 0; i < N; i++) {
        qp->du[i] = -qp->du[i];
        for (a = 0; a < NX; a++) {
            qp->du[i] -= qp->gain[i][a] * qp->dx[i][a];
        }
        for (a = 0; a < NX; a++) {
            double total = qp->B[i][a] * qp->du[i];
            for (k = 0; k < NX; k++) {
                total += qp->A[i][a][k] * qp->dx[i][k];
            }
            qp->dx[i + 1][a] = total;
        }
    }
}

/* Write down every finite bound. */
static void list_bounds(pneuid_qp *qp)
{
    int i, j, side;
    qp->bounds = 0;
    for (i = 1; i <= N; i++) {
        for (j = 0; j < NX; j++) {
            for (side = 1; side >= -1; side -= 2) {
                if (side > 0 ? qp->upper[i][j] < INFINITY : qp->lower[i][j] > -INFINITY) {
                    pneuid_qp_bound *bound = &qp->bound[qp->bounds++];
                    bound->stage = (short)i;
                    bound->state = (short)j;
                    bound->side = (short)side;
                }
            }
        }
    }
}

/* By how much each bound is exceeded (negative: room left), into violation; returns the largest. */
static double beyond(pneuid_qp *qp)
{
    double worst = -INFINITY;
    int k;
    for (k = 0; k < qp->bounds; k++) {
        const int i = qp->bound[k].stage, j = qp->bound[k].state;
        qp->violation[k] = qp->bound[k].side > 0 ? qp->x[i][j] - qp->upper[i][j] : qp->lower[i][j] - qp->x[i][j];
        worst = larger(worst, qp->violation[k]);
    }
    return worst;
}

/* Q x + q, into gx. */
static void gradient(pneuid_qp *qp)
{
    int i, j;
    for (i = 0; i <= N; i++) {
        for (j = 0; j < NX; j++) {
            qp->gx[i][j] = qp->Q[i][j] * qp->x[i][j] + qp->q[i][j];
        }
    }
}

/* Weights and gradient with what the bounds contribute; aim is the wanted slack times multiplier of each. */
static void bound_terms(pneuid_qp *qp)
{
    int k;
    memcpy(qp->Qb, qp->Q, sizeof qp->Qb);
    gradient(qp);
    for (k = 0; k < qp->bounds; k++) {
        const int i = qp->bound[k].stage, j = qp->bound[k].state, side = qp->bound[k].side;
        const double t = qp->slack[k], m = qp->multiplier[k];
        const double weight = 1.0 / (t / m + qp->give[j]);
        qp->Qb[i][j] += weight;
        qp->gx[i][j] += side * (m + weight * (qp->violation[k] - (t * m - qp->aim[k]) / m));
    }
}

/* Steps of slacks and multipliers that belong to dx; returns the longest that keeps them positive. */
static double slack_steps(pneuid_qp *qp)
{
    double step = 1.0 / TO_BOUNDARY;
    int k;
    for (k = 0; k < qp->bounds; k++) {
        const int i = qp->bound[k].stage, j = qp->bound[k].state, side = qp->bound[k].side;
        const double t = qp->slack[k], m = qp->multiplier[k], lacking = t * m - qp->aim[k];
        const double dm = (side * qp->dx[i][j] + qp->violation[k] - lacking / m) / (t / m + qp->give[j]);
        const double dt = -(lacking + t * dm) / m;
        if (dt < 0.0) {
            step = smaller(step, -t / dt);
        }
        if (dm < 0.0) {
            step = smaller(step, -m / dm);
        }
        qp->dmultiplier[k] = dm;
        qp->dslack[k] = dt;
    }
    return step;
}

/* Mean of slack times multiplier after a step. */
static double complementarity(const pneuid_qp *qp, double step)
{
    double total = 0.0;
    int k;
    for (k = 0; k < qp->bounds; k++) {
        total += (qp->slack[k] + step * qp->dslack[k]) * (qp->multiplier[k] + step * qp->dmultiplier[k]);
    }
    return total / qp->bounds;
}

/* Add a step to states and commands; returns the largest change of a command. */
static double move(pneuid_qp *qp, double step)
{
    double largest = 0.0;
    int i, j;
    for (i = 0; i <= N; i++) {
        for (j = 0; j < NX; j++) {
            qp->x[i][j] += step * qp->dx[i][j];
        }
    }
    for (i = 0; i < N; i++) {
        qp->u[i] += step * qp->du[i];
        largest = larger(largest, fabs(step * qp->du[i]));
    }
    return largest;
}

/* Weights and gradient with what the active bounds, taken for equations, contribute. */
static void active_terms(pneuid_qp *qp)
{
    int k;
    memcpy(qp->Qb, qp->Q, sizeof qp->Qb);
    gradient(qp);
    for (k = 0; k < qp->bounds; k++) {
        const int i = qp->bound[k].stage, j = qp->bound[k].state, side = qp->bound[k].side;
        if (qp->active[k]) {
            const double weight = 1.0 / (YIELD + qp->give[j]);
            qp->Qb[i][j] += weight;
            qp->gx[i][j] += side * (qp->pull[k] + weight * (qp->violation[k] - qp->give[j] * qp->pull[k]));
        }
    }
}

/* Multipliers after a step; an active bound that pulls is let go, one that is crossed joins. 1 if all stay as they were. */
static int active_after(pneuid_qp *qp)
{
    int k, same = 1;
    for (k = 0; k < qp->bounds; k++) {
        const int i = qp->bound[k].stage, j = qp->bound[k].state, side = qp->bound[k].side;
        const double after = qp->violation[k] + side * qp->dx[i][j];
        if (qp->active[k]) {
            qp->pull[k] += (after - qp->give[j] * qp->pull[k]) / (YIELD + qp->give[j]);
            if (qp->pull[k] < 0.0) {
                qp->pull[k] = 0.0;
                qp->active[k] = 0;
                same = 0;
            }
        } else if (after > EXACT) {
            qp->active[k] = 1;
            same = 0;
        }
    }
    return same;
}

/* The exact minimum from one whose active bounds show in slacks and multipliers; 0, and nothing changed, where it does not
 * settle. */
static int polish(pneuid_qp *qp)
{
    double change;
    int k;

    memcpy(qp->found_x, qp->x, sizeof qp->x);
    memcpy(qp->found_u, qp->u, sizeof qp->u);
    for (k = 0; k < qp->bounds; k++) {
        qp->active[k] = (char)(qp->multiplier[k] > qp->slack[k]);
        qp->pull[k] = qp->multiplier[k] * qp->active[k];
    }
    for (k = 0; k < POLISHES; k++) {
        (void)beyond(qp);
        active_terms(qp);
        factorise(qp, (const double(*)[NX])qp->Qb);
        direction(qp);
        change = move(qp, 1.0);
        if (active_after(qp) && change < EXACT) {
            return 1;
        }
    }
    memcpy(qp->x, qp->found_x, sizeof qp->x);
    memcpy(qp->u, qp->found_u, sizeof qp->u);
    return 0;
}

/* Mehrotra's predictor and corrector from a point that satisfies the dynamics, as every iterate does. */
static int interior_point(pneuid_qp *qp, double tolerance)
{
    double worst, step, mu, reached, centre, change;
    int k;

    for (k = 0; k < qp->bounds; k++) {
        qp->slack[k] = larger(-qp->violation[k], SMALLEST_SLACK);
        qp->multiplier[k] = FIRST_BARRIER / qp->slack[k];
    }
    for (qp->iterations = 1; qp->iterations <= LARGEST_ITERATIONS; qp->iterations++) {
        beyond(qp);
        worst = 0.0;
        for (k = 0; k < qp->bounds; k++) {
            qp->violation[k] += qp->slack[k] - qp->give[qp->bound[k].state] * qp->multiplier[k];
            worst = larger(worst, fabs(qp->violation[k]));
            qp->aim[k] = 0.0; /* predictor: aim at zero, see how far one gets */
        }
        bound_terms(qp);
        factorise(qp, (const double(*)[NX])qp->Qb);
        direction(qp);
        step = smaller(1.0, slack_steps(qp));
        /* corrector: centre as far as the predictor fell short, second-order term included */
        mu = complementarity(qp, 0.0);
        reached = complementarity(qp, step) / mu;
        centre = reached * reached * reached * mu;
        for (k = 0; k < qp->bounds; k++) {
            qp->aim[k] = centre - qp->dslack[k] * qp->dmultiplier[k];
        }
        bound_terms(qp);
        direction(qp);
        step = smaller(1.0, TO_BOUNDARY * slack_steps(qp));
        change = move(qp, step);
        for (k = 0; k < qp->bounds; k++) {
            qp->slack[k] += step * qp->dslack[k];
            qp->multiplier[k] += step * qp->dmultiplier[k];
        }
        mu = complementarity(qp, 0.0);
        if (step > 0.9 && change < sqrt(tolerance) && (1.0 - step) * worst < tolerance && mu < tolerance &&
            (polish(qp) || mu < ENOUGH)) {
            return 1;
        }
    }
    qp->iterations = LARGEST_ITERATIONS;
    return 0;
}

int pneuid_qp_solve(pneuid_qp *qp, double tolerance)
{
    memset(qp->u, 0, sizeof qp->u);
    qp->iterations = 0;
    roll_out(qp);
    factorise(qp, (const double(*)[NX])qp->Q);
    gradient(qp);
    direction(qp);
    move(qp, 1.0);
    list_bounds(qp);
    if (beyond(qp) <= 0.0) {
        return 1;
    }
    return interior_point(qp, tolerance);
}
