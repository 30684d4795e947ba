/* The identified plant as an FMU: command and supply in, position, speed and pressures out. */
#include <math.h>
#include <string.h>

#include "fmu_unit.h"
#include "fmu_variables.h"
#include "pneuid_plant.h"

typedef struct {
    double theta[PNEUID_THETA];
    pneuid_plant plant;
} unit_of_plant;

const size_t fmu_unit_bytes = sizeof(unit_of_plant);

static const char *show(const unit_of_plant *self, double *real)
{
    real[FMU_x] = self->plant.state[PNEUID_X];
    real[FMU_v] = self->plant.state[PNEUID_V];
    real[FMU_p1] = self->plant.state[PNEUID_P1];
    real[FMU_p2] = self->plant.state[PNEUID_P2];
    return isfinite(real[FMU_x] + real[FMU_v] + real[FMU_p1] + real[FMU_p2]) ? NULL : "the state is not finite";
}

/* The parameters' values, which the master may change at any time. */
static void take_parameters(unit_of_plant *self, const double *real)
{
    memcpy(self->theta, pneuid_theta, sizeof self->theta);
    memcpy(self->theta, &real[FMU_PARAMETERS], FMU_PARAMETER_COUNT * sizeof(double));
    self->plant.theta = self->theta;
}

const char *fmu_unit_start(void *unit, double *real)
{
    unit_of_plant *self = unit;
    pneuid_plant_start(&self->plant, real[FMU_x_start], real[FMU_p1_start], real[FMU_p2_start]);
    take_parameters(self, real);
    return show(self, real);
}

const char *fmu_unit_step(void *unit, double *real, double seconds)
{
    unit_of_plant *self = unit;
    take_parameters(self, real);
    pneuid_plant_advance(&self->plant, real[FMU_u], real[FMU_psup], seconds);
    return show(self, real);
}
