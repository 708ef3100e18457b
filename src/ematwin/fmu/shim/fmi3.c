/* FMI 3.0 for co-simulation (FMI standard 3.0.2, section 4), over twin.h. */

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "twin.h"

typedef uint32_t Reference;
typedef void Log(void *environment, Status status, const char *category, const char *message);
typedef void Intermediate(void *environment, double time, bool set_requested, bool get_allowed,
                          bool step_finished, bool can_return_early, bool *return_requested,
                          double *return_time);

typedef struct {
    Twin twin;
    void *environment;
    Log *log;
    Intermediate *intermediate;
    bool may_return_early;
} Instance;

/* The status of a call of twin.h that gave 0, or -1 and a reason. */
static Status told(Instance *instance, int failed) {
    if (failed && instance->log)
        instance->log(instance->environment, ERROR, "logStatusError", instance->twin.why);
    return failed ? ERROR : OK;
}

static Status refused(Instance *instance, const char *text) {
    return told(instance, twin_refuse(&instance->twin, "%s", text));
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT Status fmi3SetDebugLogging(Instance *instance, bool on, size_t count,
                                  const char *const categories[]) {
    return OK; /* only errors are logged, and these always */
}

EXPORT Instance *fmi3InstantiateCoSimulation(const char *name, const char *token,
                                             const char *resources, bool visible, bool logging,
                                             bool event_mode, bool early_return,
                                             const Reference required[], size_t count,
                                             void *environment, Log *log,
                                             Intermediate *intermediate) {
    Instance *instance = calloc(1, sizeof *instance);
    if (!instance) return NULL;
    instance->environment = environment;
    instance->log = log;
    instance->intermediate = intermediate;
    instance->may_return_early = early_return;
    const char *wrong = !token || strcmp(token, TOKEN) != 0 ? "The token is of another model."
                        : event_mode                        ? "This FMU has no event mode."
                                                            : NULL;
    if (wrong) {
        refused(instance, wrong);
        free(instance);
        return NULL;
    }
    twin_reset(&instance->twin);
    return instance;
}

EXPORT void fmi3FreeInstance(Instance *instance) { free(instance); }

EXPORT Status fmi3EnterInitializationMode(Instance *instance, bool tolerance_defined,
                                          double tolerance, double start, bool stop_defined,
                                          double stop) {
    return told(instance, twin_enter_initialization(&instance->twin, start));
}

EXPORT Status fmi3ExitInitializationMode(Instance *instance) {
    return told(instance, twin_exit_initialization(&instance->twin));
}

EXPORT Status fmi3Terminate(Instance *instance) {
    instance->twin.mode = ENDED;
    return OK;
}

EXPORT Status fmi3Reset(Instance *instance) {
    twin_reset(&instance->twin);
    return OK;
}

EXPORT Status fmi3GetFloat64(Instance *instance, const Reference references[], size_t count,
                             double values[], size_t places) {
    if (places != count) return refused(instance, "Each variable is one number.");
    return told(instance, twin_get(&instance->twin, references, count, values));
}

EXPORT Status fmi3SetFloat64(Instance *instance, const Reference references[], size_t count,
                             const double values[], size_t places) {
    int failed = 0;
    if (places != count) return refused(instance, "Each variable is one number.");
    for (size_t n = 0; n < count && !failed; n++)
        failed = twin_set(&instance->twin, references[n], values[n]);
    return told(instance, failed);
}

/* After each step the importer may set inputs for the next one, and may ask to stop there. */
EXPORT Status fmi3DoStep(Instance *instance, double point, double size, bool no_set_state,
                         bool *event_needed, bool *terminate, bool *early, double *last_time) {
    Twin *twin = &instance->twin;
    int64_t steps = twin_steps(twin, point, size);
    *event_needed = *terminate = *early = false;
    *last_time = twin_time(twin);
    if (steps < 0) return told(instance, -1);
    for (int64_t n = 1; n <= steps; n++) {
        bool wanted = false;
        double until = 0.0;
        twin_advance(twin);
        if (instance->intermediate)
            instance->intermediate(instance->environment, twin_time(twin), true, true, true,
                                   instance->may_return_early, &wanted, &until);
        if (wanted && instance->may_return_early && n < steps && twin_time(twin) >= until - STEP / 2) {
            *early = true;
            break;
        }
    }
    *last_time = *early || steps == 0 ? twin_time(twin) : point + size;
    return told(instance, twin_finish(twin));
}

EXPORT Status fmi3GetFMUState(Instance *instance, void **state) {
    return told(instance, twin_save(&instance->twin, &instance->twin, state));
}

EXPORT Status fmi3SetFMUState(Instance *instance, void *state) {
    return told(instance, twin_restore(&instance->twin, state));
}

EXPORT Status fmi3FreeFMUState(Instance *instance, void **state) {
    free(*state);
    *state = NULL;
    return OK;
}

EXPORT Status fmi3SerializedFMUStateSize(Instance *instance, void *state, size_t *size) {
    *size = sizeof(Twin);
    return OK;
}

EXPORT Status fmi3SerializeFMUState(Instance *instance, void *state, uint8_t bytes[], size_t size) {
    return told(instance, twin_pack(&instance->twin, state, bytes, size));
}

EXPORT Status fmi3DeserializeFMUState(Instance *instance, const uint8_t bytes[], size_t size,
                                      void **state) {
    return told(instance, twin_unpack(&instance->twin, bytes, size, state));
}

/* What FMI 3 has beyond: an importer that loads all functions has to find them. */
#define WITHOUT(name, ...)                                                                        \
    EXPORT Status name(Instance *instance, ##__VA_ARGS__) {                                       \
        return refused(instance, #name " is of no use here: every variable is a 64-bit number, "  \
                                       "and there are no events, clocks or derivatives.");        \
    }
#define NONE_OF(type, value)                                                                   \
    WITHOUT(fmi3Get##type, const Reference r[], size_t n, value values[], size_t m)            \
    WITHOUT(fmi3Set##type, const Reference r[], size_t n, const value values[], size_t m)
NONE_OF(Float32, float)
NONE_OF(Int8, int8_t)
NONE_OF(UInt8, uint8_t)
NONE_OF(Int16, int16_t)
NONE_OF(UInt16, uint16_t)
NONE_OF(Int32, int32_t)
NONE_OF(UInt32, uint32_t)
NONE_OF(Int64, int64_t)
NONE_OF(UInt64, uint64_t)
NONE_OF(Boolean, bool)
WITHOUT(fmi3GetString, const Reference r[], size_t n, const char *values[], size_t m)
WITHOUT(fmi3SetString, const Reference r[], size_t n, const char *const values[], size_t m)
WITHOUT(fmi3GetBinary, const Reference r[], size_t n, size_t sizes[], const uint8_t *values[],
        size_t m)
WITHOUT(fmi3SetBinary, const Reference r[], size_t n, const size_t sizes[],
        const uint8_t *const values[], size_t m)
WITHOUT(fmi3GetClock, const Reference r[], size_t n, bool values[])
WITHOUT(fmi3SetClock, const Reference r[], size_t n, const bool values[])
WITHOUT(fmi3GetNumberOfVariableDependencies, Reference reference, size_t *count)
WITHOUT(fmi3GetVariableDependencies, Reference dependent, size_t elements[],
        Reference independents[], size_t of[], int kinds[], size_t count)
WITHOUT(fmi3GetDirectionalDerivative, const Reference unknowns[], size_t n,
        const Reference knowns[], size_t m, const double seed[], size_t seeds, double result[],
        size_t results)
WITHOUT(fmi3GetAdjointDerivative, const Reference unknowns[], size_t n, const Reference knowns[],
        size_t m, const double seed[], size_t seeds, double result[], size_t results)
WITHOUT(fmi3EnterConfigurationMode)
WITHOUT(fmi3ExitConfigurationMode)
WITHOUT(fmi3GetIntervalDecimal, const Reference r[], size_t n, double intervals[], int kinds[])
WITHOUT(fmi3GetIntervalFraction, const Reference r[], size_t n, uint64_t counters[],
        uint64_t resolutions[], int kinds[])
WITHOUT(fmi3GetShiftDecimal, const Reference r[], size_t n, double shifts[])
WITHOUT(fmi3GetShiftFraction, const Reference r[], size_t n, uint64_t counters[],
        uint64_t resolutions[])
WITHOUT(fmi3SetIntervalDecimal, const Reference r[], size_t n, const double intervals[])
WITHOUT(fmi3SetIntervalFraction, const Reference r[], size_t n, const uint64_t counters[],
        const uint64_t resolutions[])
WITHOUT(fmi3SetShiftDecimal, const Reference r[], size_t n, const double shifts[])
WITHOUT(fmi3SetShiftFraction, const Reference r[], size_t n, const uint64_t counters[],
        const uint64_t resolutions[])
WITHOUT(fmi3EvaluateDiscreteStates)
WITHOUT(fmi3UpdateDiscreteStates, bool *more, bool *terminate, bool *nominals, bool *values,
        bool *defined, double *next)
WITHOUT(fmi3EnterEventMode)
WITHOUT(fmi3EnterStepMode)
WITHOUT(fmi3GetOutputDerivatives, const Reference r[], size_t n, const int32_t orders[],
        double values[], size_t m)
WITHOUT(fmi3EnterContinuousTimeMode)
WITHOUT(fmi3CompletedIntegratorStep, bool no_set_state, bool *event_mode, bool *terminate)
WITHOUT(fmi3SetTime, double time)
WITHOUT(fmi3SetContinuousStates, const double states[], size_t n)
WITHOUT(fmi3GetContinuousStateDerivatives, double values[], size_t n)
WITHOUT(fmi3GetEventIndicators, double values[], size_t n)
WITHOUT(fmi3GetContinuousStates, double states[], size_t n)
WITHOUT(fmi3GetNominalsOfContinuousStates, double nominals[], size_t n)
WITHOUT(fmi3GetNumberOfEventIndicators, size_t *n)
WITHOUT(fmi3GetNumberOfContinuousStates, size_t *n)
WITHOUT(fmi3ActivateModelPartition, Reference clock, double time)

EXPORT Instance *fmi3InstantiateModelExchange(const char *name, const char *token,
                                              const char *resources, bool visible, bool logging,
                                              void *environment, Log *log) {
    if (log) log(environment, ERROR, "logStatusError", "This FMU is for co-simulation.");
    return NULL;
}

EXPORT Instance *fmi3InstantiateScheduledExecution(const char *name, const char *token,
                                                   const char *resources, bool visible,
                                                   bool logging, void *environment, Log *log,
                                                   void (*update)(void *), void (*lock)(void),
                                                   void (*unlock)(void)) {
    if (log) log(environment, ERROR, "logStatusError", "This FMU is for co-simulation.");
    return NULL;
}
