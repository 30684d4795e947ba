#include "pneuid_nmpc.h"

#include <math.h>
#include <string.h>

#define N PNEUID_STAGES
#define NX PNEUID_NX
#define EFFECT_STATES (PNEUID_STATES - PNEUID_EFFECTS)

const size_t pneuid_nmpc_bytes = sizeof(pneuid_nmpc);

const double *pneuid_nmpc_memory(const pneuid_nmpc *self)
{
    return self->memory;
}

/* The estimate as a stage state: position, velocity, pressures, the effects' own states and the planned command. */
static void stage_state(const pneuid_nmpc *self, double x[NX])
{
    int j;
    for (j = 0; j < PNEUID_Z; j++) {
        x[j] = self->memory[j] / pneuid_scale[j];
    }
    for (j = PNEUID_EFFECTS; j < PNEUID_STATES; j++) {
        x[j - 1] = self->memory[j] / pneuid_scale[j - 1];
    }
    x[NX - 1] = self->planned / pneuid_scale[NX - 1];
}

/* Memory and plan at rest at what is trusted. */
static void at_rest(pneuid_nmpc *self)
{
    int i;
    memcpy(self->memory, pneuid_observer_rest, sizeof self->memory);
    self->memory[PNEUID_X] = self->trusted.x;
    self->memory[PNEUID_P1] = self->trusted.p1;
    self->memory[PNEUID_P2] = self->trusted.p2;
    self->planned = pneuid_neutral;
    memset(self->plan_u, 0, sizeof self->plan_u);
    for (i = 0; i <= N; i++) {
        stage_state(self, self->plan_x[i]);
    }
}

void pneuid_nmpc_init(pneuid_nmpc *self)
{
    int i;
    memset(self, 0, sizeof *self);
    self->theta = pneuid_theta;
    self->rounded = pneuid_theta_rounded;
    memcpy(self->gains, pneuid_observer_gains, sizeof self->gains);
    self->applied = pneuid_neutral;
    memcpy(self->qp.give, pneuid_nmpc_give, sizeof self->qp.give);
    for (i = 0; i <= N; i++) {
        memcpy(self->qp.Q[i], i < N ? pneuid_nmpc_weight : pneuid_nmpc_terminal, sizeof self->qp.Q[i]);
        memcpy(self->qp.lower[i], pneuid_nmpc_lower, sizeof self->qp.lower[i]);
        memcpy(self->qp.upper[i], pneuid_nmpc_upper, sizeof self->qp.upper[i]);
    }
}

int pneuid_nmpc_start(pneuid_nmpc *self, const pneuid_measurement *seen)
{
    if (!pneuid_all_finite(seen)) {
        return -1;
    }
    self->trusted = *seen;
    self->applied = pneuid_neutral;
    at_rest(self);
    return 0;
}

/* The last plan, one sample on. */
static void shift(pneuid_nmpc *self)
{
    memmove(self->plan_x[0], self->plan_x[1], N * sizeof self->plan_x[0]);
    memmove(self->plan_u, self->plan_u + 1, (N - 1) * sizeof self->plan_u[0]);
    self->plan_u[N - 1] = 0.0;
}

/* The known friction force of every stage: the bristle carried along the reference at the pressures of the plan. */
static void friction_ahead(pneuid_nmpc *self, const pneuid_reference ahead[N + 1])
{
    const double residual = self->memory[PNEUID_STATES];
    const double share = self->gains[PNEUID_OBSERVER_ALPHA] + self->memory[PNEUID_STATES + 1];
    double z = self->memory[PNEUID_Z];
    int i, j;
    for (i = 0; i < N; i++) {
        const double x = 0.5 * (ahead[i].position + ahead[i + 1].position);
        const double v = 0.5 * (ahead[i].velocity + ahead[i + 1].velocity);
        double at[PNEUID_STATES], after, force;
        at[PNEUID_X] = x;
        at[PNEUID_V] = v;
        at[PNEUID_P1] = self->plan_x[i][PNEUID_P1] * pneuid_scale[PNEUID_P1];
        at[PNEUID_P2] = self->plan_x[i][PNEUID_P2] * pneuid_scale[PNEUID_P2];
        at[PNEUID_Z] = z;
        for (j = 0; j < EFFECT_STATES; j++) {
            at[PNEUID_EFFECTS + j] = self->plan_x[i][PNEUID_Z + j] * pneuid_scale[PNEUID_Z + j];
        }
        pneuid_bristle(at, self->theta, &after, &force);
        self->force[i] = share * force + residual;
        z = after;
    }
}

void pneuid_nmpc_linearise(pneuid_nmpc *self, double psup)
{
    pneuid_qp *qp = &self->qp;
    const double low = qp->lower[0][NX - 1] + PNEUID_NMPC_ASIDE, high = qp->upper[0][NX - 1] - PNEUID_NMPC_ASIDE;
    int i, a, b;
    for (i = 0; i < N; i++) {
        const double *x = self->plan_x[i], held = x[NX - 1];
        const double u = fmin(fmax(held + self->plan_u[i], low), high) - held;
        double after[NX];
        pneuid_stage(x, &u, &self->force[i], &psup, self->rounded, after, &qp->A[i][0][0], qp->B[i]);
        for (a = 0; a < NX; a++) {
            double product = 0.0;
            for (b = 0; b < NX; b++) {
                product += qp->A[i][a][b] * x[b];
            }
            qp->c[i][a] = after[a] - product - qp->B[i][a] * u;
        }
    }
}

/* Price of a command change, gradient, supply bounds and start of the program. */
static void set_program(pneuid_nmpc *self, const pneuid_reference ahead[N + 1], double psup)
{
    const double share = fmin(fmax(psup, pneuid_ambient) / pneuid_nmpc_supply, 1.0);
    pneuid_qp *qp = &self->qp;
    int i;
    qp->R = pneuid_nmpc_change * share * share;
    for (i = 0; i <= N; i++) {
        qp->q[i][PNEUID_X] = -qp->Q[i][PNEUID_X] * (ahead[i].position / pneuid_scale[PNEUID_X]);
        qp->q[i][PNEUID_V] = -qp->Q[i][PNEUID_V] * (ahead[i].velocity / pneuid_scale[PNEUID_V]);
        qp->upper[i][PNEUID_P1] = 1.05 * psup / pneuid_scale[PNEUID_P1];
        qp->upper[i][PNEUID_P2] = 1.05 * psup / pneuid_scale[PNEUID_P2];
    }
    stage_state(self, qp->x[0]);
}

/* 1 when every command of the plan is finite. */
static int sound(const pneuid_qp *qp)
{
    int i;
    for (i = 0; i < N; i++) {
        if (!isfinite(qp->u[i])) {
            return 0;
        }
    }
    return 1;
}

/* One real-time iteration; the command for the valve [V], NAN when the program has no solution. */
static double command(pneuid_nmpc *self, const pneuid_reference ahead[N + 1])
{
    const double psup = self->trusted.psup, lead = PNEUID_NMPC_INTERVAL;
    pneuid_qp *qp = &self->qp;
    double u;

    shift(self);
    friction_ahead(self, ahead);
    pneuid_nmpc_linearise(self, psup);
    set_program(self, ahead, psup);
    (void)pneuid_qp_solve(qp, PNEUID_NMPC_TOLERANCE);
    if (!sound(qp)) {
        return NAN;
    }
    memcpy(self->plan_x, qp->x, sizeof self->plan_x);
    memcpy(self->plan_u, qp->u, sizeof self->plan_u);
    self->planned = qp->x[1][NX - 1] * pneuid_scale[NX - 1];
    pneuid_same_effect(&self->planned, self->memory, &psup, &lead, self->rounded, self->theta, &u);
    return u;
}

double pneuid_nmpc_step(
    pneuid_nmpc *self, const pneuid_measurement *seen, const pneuid_reference target[PNEUID_NMPC_PREVIEW])
{
    double after[PNEUID_OBSERVER_MEMORY], u;
    const pneuid_measurement now = pneuid_trusted(seen, &self->trusted);
    const double sensors[4] = {now.x, now.p1, now.p2, now.psup};

    self->trusted = now;
    pneuid_observer(self->memory, sensors, &self->applied, self->gains, self->theta, after);
    memcpy(self->memory, after, sizeof after);
    /* the command acts from the next sample on */
    u = command(self, target + 1);
    if (!isfinite(u)) {
        at_rest(self);
        u = pneuid_neutral;
    }
    self->applied = pneuid_limited(u);
    return self->applied;
}
