/* The friction-compensating servo: position loop, force loop, inverse of the identified valve, LuGre observer that
 * follows the pressures, and an extended state observer for the force that the model does not explain.
 *
 * All memory is in the structure: as many servos as there are structures, no heap, no hidden state.
 * Timing: the command returned at sample k acts from sample k + 1 on, PNEUID_SERVO_INTERVAL seconds later. */
#ifndef PNEUID_SERVO_H
#define PNEUID_SERVO_H

#include <stddef.h>

#include "pneuid_guard.h"
#include "pneuid_model.h"

typedef struct {
    const double *theta;                /* numbers of the model, places as in pneuid_model.h */
    double gains[PNEUID_SERVO_GAINS];   /* may be changed between samples */
    double memory[PNEUID_SERVO_MEMORY]; /* estimates: x, v, p1, p2, bristle, ..., see README.md */
    pneuid_measurement trusted;         /* the last finite value of every sensor */
    double applied;                     /* command that acts during the present sample [V] */
} pneuid_servo;

/* sizeof(pneuid_servo), for callers in other languages. */
extern const size_t pneuid_servo_bytes;

/* The estimates, for the same callers: plant state, residual force [N], learned share of friction. */
const double *pneuid_servo_memory(const pneuid_servo *self);

/* Numbers and gains of the export. Call it once, before the first start. */
void pneuid_servo_init(pneuid_servo *self);

/* Start at rest at what the sensors show, valve closed. Returns 0, or -1 and does nothing when a value is not finite. */
int pneuid_servo_start(pneuid_servo *self, const pneuid_measurement *seen);

/* Command [V] for the next sample. target: rows of the reference for this sample and the next. */
double pneuid_servo_step(pneuid_servo *self, const pneuid_measurement *seen, const pneuid_reference target[2]);

#endif
