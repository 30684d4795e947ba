/* FMI 2.0 co-simulation around one unit (fmu_unit.h). Only reals; no saved states, no input derivatives. */
#include <stdlib.h>
#include <string.h>

#include "fmi2.h"
#include "fmu_unit.h"
#include "fmu_variables.h"

typedef struct {
    double real[FMU_REALS];
    void *unit;
    int started;
    char name[64];
    const fmi2CallbackFunctions *callbacks;
} slave;

static fmi2Status complain(const slave *self, const char *what)
{
    if (self->callbacks != NULL && self->callbacks->logger != NULL) {
        self->callbacks->logger(self->callbacks->componentEnvironment, self->name, fmi2Error, "logStatusError", "%s", what);
    }
    return fmi2Error;
}

static fmi2Status verdict(const slave *self, const char *fault)
{
    return fault == NULL ? fmi2OK : complain(self, fault);
}

static fmi2Status absent(fmi2Component c, size_t count)
{
    return count == 0 ? fmi2OK : complain(c, "this FMU has variables of type Real only");
}

FMI2_EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

FMI2_EXPORT const char *fmi2GetVersion(void)
{
    return "2.0";
}

FMI2_EXPORT fmi2Component fmi2Instantiate(
    fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *callbacks,
    fmi2Boolean visible, fmi2Boolean logging)
{
    slave *self;
    (void)resources;
    (void)visible;
    (void)logging;
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, FMU_GUID) != 0) {
        return NULL;
    }
    self = calloc(1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    self->unit = calloc(1, fmu_unit_bytes);
    if (self->unit == NULL) {
        free(self);
        return NULL;
    }
    memcpy(self->real, fmu_start, sizeof self->real);
    strncpy(self->name, name != NULL ? name : "", sizeof self->name - 1);
    self->callbacks = callbacks;
    return self;
}

FMI2_EXPORT void fmi2FreeInstance(fmi2Component c)
{
    slave *self = c;
    if (self != NULL) {
        free(self->unit);
        free(self);
    }
}

FMI2_EXPORT fmi2Status fmi2SetDebugLogging(
    fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    (void)c;
    (void)on;
    (void)count;
    (void)categories;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2SetupExperiment(
    fmi2Component c, fmi2Boolean with_tolerance, fmi2Real tolerance, fmi2Real start, fmi2Boolean with_stop, fmi2Real stop)
{
    (void)c;
    (void)with_tolerance;
    (void)tolerance;
    (void)start;
    (void)with_stop;
    (void)stop;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    slave *self = c;
    self->started = 1;
    return verdict(self, fmu_unit_start(self->unit, self->real));
}

FMI2_EXPORT fmi2Status fmi2Terminate(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2Reset(fmi2Component c)
{
    slave *self = c;
    memcpy(self->real, fmu_start, sizeof self->real);
    self->started = 0;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Real value[])
{
    slave *self = c;
    size_t i;
    if (!self->started) {
        /* outputs follow the start values already while these are being set */
        const char *fault = fmu_unit_start(self->unit, self->real);
        if (fault != NULL) {
            return complain(self, fault);
        }
    }
    for (i = 0; i < count; i++) {
        if (vr[i] >= FMU_REALS) {
            return complain(self, "no such variable");
        }
        value[i] = self->real[vr[i]];
    }
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Real value[])
{
    slave *self = c;
    size_t i;
    for (i = 0; i < count; i++) {
        if (vr[i] >= FMU_REALS) {
            return complain(self, "no such variable");
        }
        self->real[vr[i]] = value[i];
    }
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real step, fmi2Boolean final)
{
    slave *self = c;
    (void)now;
    (void)final;
    if (!(step > 0.0)) {
        return complain(self, "the communication step must be positive");
    }
    return verdict(self, fmu_unit_step(self->unit, self->real, step));
}

/* What the standard asks every FMU to export, for what this one does not have. */

#define NOT_HERE(c) complain(c, "not supported by this FMU")

FMI2_EXPORT fmi2Status fmi2CancelStep(fmi2Component c)
{
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Integer value[])
{
    (void)vr;
    (void)value;
    return absent(c, count);
}

FMI2_EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Boolean value[])
{
    (void)vr;
    (void)value;
    return absent(c, count);
}

FMI2_EXPORT fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2String value[])
{
    (void)vr;
    (void)value;
    return absent(c, count);
}

FMI2_EXPORT fmi2Status fmi2SetInteger(
    fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Integer value[])
{
    (void)vr;
    (void)value;
    return absent(c, count);
}

FMI2_EXPORT fmi2Status fmi2SetBoolean(
    fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Boolean value[])
{
    (void)vr;
    (void)value;
    return absent(c, count);
}

FMI2_EXPORT fmi2Status fmi2SetString(
    fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2String value[])
{
    (void)vr;
    (void)value;
    return absent(c, count);
}

FMI2_EXPORT fmi2Status fmi2SetRealInputDerivatives(
    fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return count == 0 ? fmi2OK : NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2GetRealOutputDerivatives(
    fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return count == 0 ? fmi2OK : NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind;
    (void)value;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    (void)kind;
    (void)value;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)kind;
    (void)value;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    (void)kind;
    (void)value;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)kind;
    (void)value;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)state;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    (void)state;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)state;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)state;
    (void)size;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    (void)state;
    (void)bytes;
    (void)size;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2DeSerializeFMUstate(
    fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    (void)bytes;
    (void)size;
    (void)state;
    return NOT_HERE(c);
}

FMI2_EXPORT fmi2Status fmi2GetDirectionalDerivative(
    fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns, const fmi2ValueReference known[], size_t knowns,
    const fmi2Real seed[], fmi2Real value[])
{
    (void)unknown;
    (void)unknowns;
    (void)known;
    (void)knowns;
    (void)seed;
    (void)value;
    return NOT_HERE(c);
}
