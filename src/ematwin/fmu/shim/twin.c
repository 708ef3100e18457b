/* Time, inputs, parameters and saved states of an actuator; its physics is in machine code.

The functions of ematwin_* come from the kernels with which ematwin simulates. Each takes two
pointers first, which receive a result and an exception; there is neither.

Outputs are those of a logger that samples every SUBSTEPS steps. At a sample they answer to the
inputs as they are set, so that a direct feedthrough is seen at once; the sample is over when the
next step begins. Between samples the last one stands. */

#include "twin.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int ematwin_constants(void **result, void **raised, const double *p, double *c);
int ematwin_begin(void **result, void **raised, const double *c, double *u, double *x);
int ematwin_sample(void **result, void **raised, const double *c, double *x, const double *u,
                   int64_t n, double *y);
int ematwin_advance(void **result, void **raised, const double *c, double *x, const double *u);

static const double at[2] = {AT_COMMAND, AT_LOAD};
static const char NO_VARIABLE[] = "There is no variable of this reference.";
static const char OTHER_MODEL[] = "The state belongs to another model.";

int twin_refuse(Twin *twin, const char *format, ...) {
    va_list given;
    va_start(given, format);
    vsnprintf(twin->why, sizeof twin->why, format, given);
    va_end(given);
    return -1;
}

static void update_constants(Twin *twin) {
    void *none, *raised;
    if (twin->changed) ematwin_constants(&none, &raised, twin->p, twin->c);
    twin->changed = 0;
}

static void sample(const Twin *twin, double *x, const double *u, double *y) {
    void *none, *raised;
    ematwin_sample(&none, &raised, twin->c, x, u, HELD + twin->steps / SUBSTEPS, y);
}

/* Inputs some steps after the communication point; the command and the load at their own share. */
static void inputs(const Twin *twin, double command_after, double load_after, double *u) {
    u[0] = twin->u[0] + twin->rate[0] * (command_after * STEP);
    u[1] = twin->u[1] + twin->rate[1] * (load_after * STEP);
}

void twin_reset(Twin *twin) {
    memset(twin, 0, sizeof *twin);
    strncpy(twin->token, TOKEN, sizeof twin->token - 1);
    for (size_t n = 0; n < PARAMETERS; n++) twin->p[n] = variables[FIRST_PARAMETER + n].start;
    twin->changed = 1;
}

static void begin(Twin *twin) {
    void *none, *raised;
    double held[2] = {twin->u[0], twin->u[1]};
    update_constants(twin);
    twin->steps = twin->since = 0;
    ematwin_begin(&none, &raised, twin->c, held, twin->x);
    for (int64_t n = 0; n < HELD; n++) {
        ematwin_sample(&none, &raised, twin->c, twin->x, held, n, twin->y);
        for (int j = 0; j < SUBSTEPS; j++)
            ematwin_advance(&none, &raised, twin->c, twin->x, held);
    }
}

double twin_time(const Twin *twin) {
    return twin->start + (double)twin->steps * STEP;
}

int twin_enter_initialization(Twin *twin, double start) {
    if (twin->mode != INSTANTIATED)
        return twin_refuse(twin, "The initialization comes after instantiation or a reset.");
    twin->start = start;
    twin->mode = INITIALIZING;
    return 0;
}

int twin_exit_initialization(Twin *twin) {
    if (twin->mode != INITIALIZING) return twin_refuse(twin, "The initialization was not entered.");
    begin(twin);
    twin->mode = RUNNING;
    return 0;
}

int twin_set(Twin *twin, unsigned reference, double value) {
    if (reference >= VARIABLES) return twin_refuse(twin, NO_VARIABLE);
    const Variable *one = &variables[reference];
    if (one->role == 'f' && twin->mode > INITIALIZING)
        return twin_refuse(
            twin, "%s is fixed: set it before the initialization ends, or reset first.", one->name);
    if (one->role != 'i' && one->role != 'f' && one->role != 't')
        return twin_refuse(twin, "%s cannot be set.", one->name);
    if (!(value >= one->lower && value <= one->upper)) { /* NaN fails this as well */
        int above = one->lower > 0.0 && one->lower < 1e-300; /* more than zero, as XML has it */
        return twin_refuse(twin, "%s must lie in %s%g, %g]%s%s, received %g; it stays as it was.",
                           one->name, above ? "(" : "[", above ? 0.0 : one->lower, one->upper,
                           *one->unit ? " " : "", one->unit, value);
    }
    if (one->role == 'i') {
        twin->u[reference - FIRST_INPUT] = value;
    } else {
        twin->p[reference - FIRST_PARAMETER] = value;
        twin->changed = 1;
    }
    return 0;
}

int twin_set_rate(Twin *twin, unsigned reference, double value) {
    if (reference >= VARIABLES || variables[reference].role != 'i')
        return twin_refuse(twin, "Only inputs have a derivative here.");
    if (!isfinite(value)) return twin_refuse(twin, "The derivative of an input must be finite.");
    twin->rate[reference - FIRST_INPUT] = value;
    return 0;
}

int twin_get(Twin *twin, const unsigned references[], size_t count, double values[]) {
    double y[OUTPUTS];
    int known = 0;
    for (size_t n = 0; n < count; n++) {
        unsigned reference = references[n];
        if (reference >= VARIABLES) return twin_refuse(twin, NO_VARIABLE);
        char role = variables[reference].role;
        if (role == 'o' && !known) {
            Twin now = *twin; /* the sample itself is taken when the next step begins */
            if (now.mode <= INITIALIZING) begin(&now);
            update_constants(&now);
            double u[2];
            inputs(&now, (double)now.since, (double)now.since, u);
            if (now.steps % SUBSTEPS == 0) sample(&now, now.x, u, now.y);
            memcpy(y, now.y, sizeof y);
            known = 1;
        }
        values[n] = role == 'c'   ? variables[reference].start
                    : role == 's' ? twin_time(twin)
                    : role == 'i' ? twin->u[reference - FIRST_INPUT]
                    : role == 'o' ? y[reference - FIRST_OUTPUT]
                                  : twin->p[reference - FIRST_PARAMETER];
    }
    return 0;
}

int twin_restore(Twin *twin, const Twin *saved) {
    if (memcmp(saved->token, twin->token, sizeof twin->token) != 0)
        return twin_refuse(twin, OTHER_MODEL);
    *twin = *saved;
    return 0;
}

int twin_save(Twin *twin, const void *from, void **state) {
    if (!*state) *state = malloc(sizeof(Twin));
    if (!*state) return twin_refuse(twin, "Not enough memory.");
    memcpy(*state, from, sizeof(Twin));
    return 0;
}

int twin_pack(Twin *twin, const void *state, void *bytes, size_t size) {
    if (size < sizeof(Twin)) return twin_refuse(twin, "There is no room for the state.");
    memcpy(bytes, state, sizeof(Twin));
    return 0;
}

int twin_unpack(Twin *twin, const void *bytes, size_t size, void **state) {
    if (size != sizeof(Twin)) return twin_refuse(twin, OTHER_MODEL);
    return twin_save(twin, bytes, state);
}

int64_t twin_steps(Twin *twin, double point, double size) {
    if (twin->mode != RUNNING) return twin_refuse(twin, "A step comes after the initialization.");
    double off = (point - twin_time(twin)) / STEP;
    if (!(fabs(off) <= 0.5 + 1e-6))
        return twin_refuse(twin,
                           "The communication point must be %.9g s, where the last step ended, "
                           "received %.9g s.",
                           twin_time(twin), point);
    double last = floor((point + size - twin->start) / STEP + 0.5);
    if (!(size >= 0.0 && last < 9e15))
        return twin_refuse(twin, "The communication step must be a positive number of seconds.");
    return (int64_t)last > twin->steps ? (int64_t)last - twin->steps : 0;
}

void twin_advance(Twin *twin) {
    void *none, *raised;
    double u[2], since = (double)twin->since;
    update_constants(twin);
    if (twin->steps % SUBSTEPS == 0) {
        inputs(twin, since, since, u);
        sample(twin, twin->x, u, twin->y);
    }
    inputs(twin, since + at[0], since + at[1], u);
    ematwin_advance(&none, &raised, twin->c, twin->x, u);
    twin->steps++;
    twin->since++;
}

int twin_finish(Twin *twin) {
    double lost = 0.0;
    inputs(twin, (double)twin->since, (double)twin->since, twin->u);
    twin->rate[0] = twin->rate[1] = 0.0;
    twin->since = 0;
    for (size_t n = 0; n < STATES; n++) lost += 0.0 * twin->x[n];
    if (lost == 0.0) return 0;
    return twin_refuse(twin, "The model diverged: check its parameters and inputs.");
}
