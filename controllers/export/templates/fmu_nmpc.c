/* The predictive controller as an FMU. Its inputs are what stands at the beginning of a step; its output acts in the
 * next one. Of the reference it looks at position and velocity only. */
#include <math.h>

#include "fmu_unit.h"
#include "fmu_variables.h"
#include "pneuid_nmpc.h"

const size_t fmu_unit_bytes = sizeof(pneuid_nmpc);

static pneuid_measurement measured(const double *real)
{
    const pneuid_measurement seen = {real[FMU_x], real[FMU_p1], real[FMU_p2], real[FMU_psup]};
    return seen;
}

const char *fmu_unit_start(void *unit, double *real)
{
    const pneuid_measurement seen = measured(real);
    pneuid_nmpc_init(unit);
    if (pneuid_nmpc_start(unit, &seen) != 0) {
        return "x, p1, p2 and psup must be finite at the start";
    }
    real[FMU_u] = pneuid_neutral;
    return NULL;
}

const char *fmu_unit_step(void *unit, double *real, double seconds)
{
    const pneuid_measurement seen = measured(real);
    pneuid_reference target[PNEUID_NMPC_PREVIEW];
    int i;
    if (fabs(seconds - PNEUID_NMPC_INTERVAL) > 1e-6 * PNEUID_NMPC_INTERVAL) {
        return "the communication step must be the sample time of the predictive controller";
    }
    for (i = 0; i < PNEUID_NMPC_PREVIEW; i++) {
        target[i].position = real[FMU_position_0 + i];
        target[i].velocity = real[FMU_velocity_0 + i];
        target[i].acceleration = 0.0;
        target[i].jerk = 0.0;
    }
    real[FMU_u] = pneuid_nmpc_step(unit, &seen, target);
    return NULL;
}
