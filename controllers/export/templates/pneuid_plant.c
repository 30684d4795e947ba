#include "pneuid_plant.h"

#include <math.h>
#include <string.h>

void pneuid_plant_start(pneuid_plant *self, double x, double p1, double p2)
{
    self->theta = pneuid_theta;
    memcpy(self->state, pneuid_observer_rest, sizeof self->state);
    self->state[PNEUID_X] = x;
    self->state[PNEUID_P1] = p1;
    self->state[PNEUID_P2] = p2;
}

void pneuid_plant_advance(pneuid_plant *self, double u, double psup, double seconds)
{
    /* an interval that is a whole number of steps but for rounding takes no step more */
    const int count = (int)fmax(1.0, ceil(seconds / PNEUID_PLANT_STEP - 1e-9));
    const double given[2] = {u, psup}, h = seconds / count;
    double after[PNEUID_STATES];
    int k;
    for (k = 0; k < count; k++) {
        pneuid_plant_step(self->state, given, &h, self->theta, after);
        memcpy(self->state, after, sizeof after);
    }
}
