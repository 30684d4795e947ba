/* The identified plant as a simulator: for a test bench without the rig, and for the FMU. */
#ifndef PNEUID_PLANT_H
#define PNEUID_PLANT_H

#include "pneuid_model.h"

typedef struct {
    const double *theta;          /* numbers of the model, places as in pneuid_model.h */
    double state[PNEUID_STATES];  /* x [m], v [m/s], p1, p2 [Pa, absolute], bristle [m], the effects' own states */
} pneuid_plant;

/* At rest at x [m] with chamber pressures p1, p2 [Pa, absolute]. */
void pneuid_plant_start(pneuid_plant *self, double x, double p1, double p2);

/* seconds later, the command u [V] and the supply psup [Pa, absolute] held; in equal steps of at most
 * PNEUID_PLANT_STEP seconds. */
void pneuid_plant_advance(pneuid_plant *self, double u, double psup, double seconds);

#endif
