#include "pneuid_servo.h"

#include <math.h>
#include <string.h>

const size_t pneuid_servo_bytes = sizeof(pneuid_servo);

const double *pneuid_servo_memory(const pneuid_servo *self)
{
    return self->memory;
}

/* The memory of a servo at rest at what is trusted. */
static void at_rest(pneuid_servo *self)
{
    memcpy(self->memory, pneuid_servo_rest, sizeof self->memory);
    self->memory[PNEUID_X] = self->trusted.x;
    self->memory[PNEUID_P1] = self->trusted.p1;
    self->memory[PNEUID_P2] = self->trusted.p2;
}

void pneuid_servo_init(pneuid_servo *self)
{
    memset(self, 0, sizeof *self);
    self->theta = pneuid_theta;
    memcpy(self->gains, pneuid_servo_gains, sizeof self->gains);
    self->applied = pneuid_neutral;
}

int pneuid_servo_start(pneuid_servo *self, const pneuid_measurement *seen)
{
    if (!pneuid_all_finite(seen)) {
        return -1;
    }
    self->trusted = *seen;
    self->applied = pneuid_neutral;
    at_rest(self);
    return 0;
}

double pneuid_servo_step(pneuid_servo *self, const pneuid_measurement *seen, const pneuid_reference target[2])
{
    double after[PNEUID_SERVO_MEMORY], u[1];
    const pneuid_measurement now = pneuid_trusted(seen, &self->trusted);
    const double sensors[4] = {now.x, now.p1, now.p2, now.psup};
    const double rows[8] = {
        target[0].position, target[0].velocity, target[0].acceleration, target[0].jerk,
        target[1].position, target[1].velocity, target[1].acceleration, target[1].jerk,
    };

    self->trusted = now;
    pneuid_servo_law(self->memory, sensors, rows, &self->applied, self->gains, self->theta, u, after);
    memcpy(self->memory, after, sizeof after);
    if (!isfinite(u[0])) {
        at_rest(self);
        u[0] = pneuid_neutral;
    }
    self->applied = pneuid_limited(u[0]);
    return self->applied;
}
