/* What stands inside an FMU: a unit that is started and stepped, with its variables in one array of doubles.
 * fmu_variables.h, generated, names the places in that array and their start values. */
#ifndef PNEUID_FMU_UNIT_H
#define PNEUID_FMU_UNIT_H

#include <stddef.h>

extern const size_t fmu_unit_bytes;

/* Start from the variables' values; write the outputs. Returns NULL, or what is wrong with the values. */
const char *fmu_unit_start(void *unit, double *real);

/* seconds later; read the inputs, write the outputs. Returns NULL, or what is wrong. */
const char *fmu_unit_step(void *unit, double *real, double seconds);

#endif
