/* What every controller does at its edges: distrust the sensors, limit the command. */
#ifndef PNEUID_GUARD_H
#define PNEUID_GUARD_H

/* What the sensors show: position [m], chamber and supply pressures [Pa, absolute]. */
typedef struct {
    double x, p1, p2, psup;
} pneuid_measurement;

/* One row of a reference: m, m/s, m/s^2, m/s^3. */
typedef struct {
    double position, velocity, acceleration, jerk;
} pneuid_reference;

/* 1 when every value is finite, else 0. */
int pneuid_all_finite(const pneuid_measurement *seen);

/* The measurement with each value that is not finite replaced by the last finite one of that sensor. */
pneuid_measurement pneuid_trusted(const pneuid_measurement *seen, const pneuid_measurement *before);

/* The command within the valve's range [V]. */
double pneuid_limited(double u);

#endif
