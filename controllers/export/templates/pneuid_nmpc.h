/* Nonlinear model predictive control by the real-time iteration: every sample the identified plant is linearised along
 * the last plan and one quadratic program gives the next command. Friction enters as a known force over the horizon:
 * the observer's bristle carried along the reference, plus the residual force.
 *
 * All memory is in the structure (sizeof in README.md): no heap, no hidden state.
 * Timing: the command returned at sample k acts from sample k + 1 on, PNEUID_NMPC_INTERVAL seconds later.
 * Source: Diehl, Bock, Schloeder, SIAM J. Control Optim. 43 (2005) 1714. */
#ifndef PNEUID_NMPC_H
#define PNEUID_NMPC_H

#include <stddef.h>

#include "pneuid_guard.h"
#include "pneuid_model.h"
#include "pneuid_qp.h"

#define PNEUID_NMPC_PREVIEW (PNEUID_STAGES + 2)

typedef struct {
    const double *theta;                  /* numbers of the model, places as in pneuid_model.h */
    const double *rounded;                /* the same with a rounded valve, which the plan is made on */
    double gains[PNEUID_OBSERVER_GAINS];  /* of the observer; the weights of the plan are in qp.Q and qp.R */
    double memory[PNEUID_OBSERVER_MEMORY];
    pneuid_measurement trusted;           /* the last finite value of every sensor */
    double applied;                       /* command that acts during the present sample [V] */
    double planned;                       /* what the plan said of it [V] */
    double plan_x[PNEUID_STAGES + 1][PNEUID_NX], plan_u[PNEUID_STAGES];
    double force[PNEUID_STAGES];          /* known friction of every stage [N] */
    pneuid_qp qp;
} pneuid_nmpc;

/* sizeof(pneuid_nmpc), for callers in other languages. */
extern const size_t pneuid_nmpc_bytes;

/* The estimates, for the same callers: plant state, residual force [N], learned share of friction. */
const double *pneuid_nmpc_memory(const pneuid_nmpc *self);

/* Numbers, gains and weights of the export. Call it once, before the first start. */
void pneuid_nmpc_init(pneuid_nmpc *self);

/* Start at rest at what the sensors show, valve closed. Returns 0, or -1 and does nothing when a value is not finite. */
int pneuid_nmpc_start(pneuid_nmpc *self, const pneuid_measurement *seen);

/* Command [V] for the next sample. target: rows of the reference from this sample on, one per sample. */
double pneuid_nmpc_step(
    pneuid_nmpc *self, const pneuid_measurement *seen, const pneuid_reference target[PNEUID_NMPC_PREVIEW]);

/* The parts of a step that its time goes into, for a profile: the stages linearised along the plan under the supply
 * pressure psup [Pa, absolute], and the quadratic program made of them. */
void pneuid_nmpc_linearise(pneuid_nmpc *self, double psup);

#endif
