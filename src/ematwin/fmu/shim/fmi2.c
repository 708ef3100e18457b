/* FMI 2.0 for co-simulation (FMI standard 2.0.5, section 4), over twin.h. */

#include <stdlib.h>
#include <string.h>

#include "twin.h"

typedef enum { MODEL_EXCHANGE, CO_SIMULATION } Type;
typedef enum { DO_STEP, PENDING_STATUS, LAST_SUCCESSFUL_TIME, TERMINATED } StatusKind;

typedef struct {
    void (*logger)(void *environment, const char *instance, Status status, const char *category,
                   const char *message, ...);
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*step_finished)(void *environment, Status status);
    void *environment;
} Callbacks;

typedef struct {
    Twin twin;
    char *name;
    Callbacks callbacks;
} Instance;

/* The status of a call of twin.h that gave 0, or -1 and a reason. */
static Status told(Instance *instance, int failed) {
    if (failed && instance->callbacks.logger)
        instance->callbacks.logger(instance->callbacks.environment, instance->name, ERROR,
                                   "logStatusError", instance->twin.why); /* no % in any reason */
    return failed ? ERROR : OK;
}

static Status refused(Instance *instance, const char *text) {
    return told(instance, twin_refuse(&instance->twin, "%s", text));
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT Status fmi2SetDebugLogging(Instance *instance, int on, size_t count,
                                  const char *const categories[]) {
    return OK; /* only errors are logged, and these always */
}

EXPORT Instance *fmi2Instantiate(const char *name, Type type, const char *token,
                                 const char *resources, const Callbacks *callbacks, int visible,
                                 int logging) {
    Instance *instance = calloc(1, sizeof *instance);
    if (!instance) return NULL;
    if (callbacks) instance->callbacks = *callbacks;
    instance->name = calloc(1, strlen(name ? name : "") + 1);
    if (instance->name && name) strcpy(instance->name, name);
    const char *wrong = !instance->name                      ? "Not enough memory."
                        : type != CO_SIMULATION              ? "This FMU is for co-simulation."
                        : !token || strcmp(token, TOKEN) != 0 ? "The GUID is of another model."
                                                             : NULL;
    if (wrong) {
        refused(instance, wrong);
        free(instance->name);
        free(instance);
        return NULL;
    }
    twin_reset(&instance->twin);
    return instance;
}

EXPORT void fmi2FreeInstance(Instance *instance) {
    if (!instance) return;
    free(instance->name);
    free(instance);
}

EXPORT Status fmi2SetupExperiment(Instance *instance, int tolerance_defined, double tolerance,
                                  double start, int stop_defined, double stop) {
    instance->twin.start = start;
    return OK;
}

EXPORT Status fmi2EnterInitializationMode(Instance *instance) {
    return told(instance, twin_enter_initialization(&instance->twin, instance->twin.start));
}

EXPORT Status fmi2ExitInitializationMode(Instance *instance) {
    return told(instance, twin_exit_initialization(&instance->twin));
}

EXPORT Status fmi2Terminate(Instance *instance) {
    instance->twin.mode = ENDED;
    return OK;
}

EXPORT Status fmi2Reset(Instance *instance) {
    twin_reset(&instance->twin);
    return OK;
}

EXPORT Status fmi2GetReal(Instance *instance, const unsigned references[], size_t count,
                          double values[]) {
    return told(instance, twin_get(&instance->twin, references, count, values));
}

EXPORT Status fmi2SetReal(Instance *instance, const unsigned references[], size_t count,
                          const double values[]) {
    int failed = 0;
    for (size_t n = 0; n < count && !failed; n++)
        failed = twin_set(&instance->twin, references[n], values[n]);
    return told(instance, failed);
}

EXPORT Status fmi2SetRealInputDerivatives(Instance *instance, const unsigned references[],
                                          size_t count, const int order[], const double values[]) {
    int failed = 0;
    for (size_t n = 0; n < count && !failed; n++) {
        if (order[n] != 1) return refused(instance, "Inputs have first derivatives alone.");
        failed = twin_set_rate(&instance->twin, references[n], values[n]);
    }
    return told(instance, failed);
}

EXPORT Status fmi2DoStep(Instance *instance, double point, double size, int no_set_state) {
    int64_t steps = twin_steps(&instance->twin, point, size);
    if (steps < 0) return told(instance, -1);
    for (int64_t n = 0; n < steps; n++) twin_advance(&instance->twin);
    return told(instance, twin_finish(&instance->twin));
}

EXPORT Status fmi2GetFMUstate(Instance *instance, void **state) {
    return told(instance, twin_save(&instance->twin, &instance->twin, state));
}

EXPORT Status fmi2SetFMUstate(Instance *instance, void *state) {
    return told(instance, twin_restore(&instance->twin, state));
}

EXPORT Status fmi2FreeFMUstate(Instance *instance, void **state) {
    free(*state);
    *state = NULL;
    return OK;
}

EXPORT Status fmi2SerializedFMUstateSize(Instance *instance, void *state, size_t *size) {
    *size = sizeof(Twin);
    return OK;
}

EXPORT Status fmi2SerializeFMUstate(Instance *instance, void *state, char bytes[], size_t size) {
    return told(instance, twin_pack(&instance->twin, state, bytes, size));
}

EXPORT Status fmi2DeSerializeFMUstate(Instance *instance, const char bytes[], size_t size,
                                      void **state) {
    return told(instance, twin_unpack(&instance->twin, bytes, size, state));
}

EXPORT Status fmi2GetRealStatus(Instance *instance, StatusKind kind, double *value) {
    if (kind != LAST_SUCCESSFUL_TIME) return DISCARD;
    *value = twin_time(&instance->twin);
    return OK;
}

EXPORT Status fmi2GetBooleanStatus(Instance *instance, StatusKind kind, int *value) {
    if (kind != TERMINATED) return DISCARD;
    *value = 0;
    return OK;
}

EXPORT Status fmi2GetStatus(Instance *instance, StatusKind kind, Status *value) { return DISCARD; }
EXPORT Status fmi2GetIntegerStatus(Instance *instance, StatusKind kind, int *value) {
    return DISCARD;
}
EXPORT Status fmi2GetStringStatus(Instance *instance, StatusKind kind, const char **value) {
    return DISCARD;
}
EXPORT Status fmi2CancelStep(Instance *instance) {
    return refused(instance, "A step ends before it returns.");
}

/* Every variable is a real number. */
#define NONE_OF(name, values)                                                                 \
    EXPORT Status name(Instance *instance, const unsigned references[], size_t count, values) { \
        return count ? refused(instance, #name ": there is no such variable.") : OK;          \
    }
NONE_OF(fmi2GetInteger, int value[])
NONE_OF(fmi2GetBoolean, int value[])
NONE_OF(fmi2GetString, const char *value[])
NONE_OF(fmi2SetInteger, const int value[])
NONE_OF(fmi2SetBoolean, const int value[])
NONE_OF(fmi2SetString, const char *const value[])

EXPORT Status fmi2GetDirectionalDerivative(Instance *instance, const unsigned unknown[],
                                           size_t unknowns, const unsigned known[], size_t knowns,
                                           const double change[], double changed[]) {
    return refused(instance, "This FMU gives no directional derivatives.");
}

EXPORT Status fmi2GetRealOutputDerivatives(Instance *instance, const unsigned references[],
                                           size_t count, const int order[], double values[]) {
    return refused(instance, "This FMU gives no derivatives of outputs.");
}
