/* Time, inputs, parameters and saved states of an actuator; its physics is in machine code.

The functions of ematwin_* come from the kernels with which ematwin simulates. Each takes two
pointers first, which receive a result and an exception; there is neither.

Outputs are those of a logger that samples every SUBSTEPS steps. At a sample they answer to the
inputs as they are set, so that a direct feedthrough is seen at once; the sample is over when the
next step begins. Between samples the last one stands. */

#include "twin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int ematwin_constants(void **result, void **raised, const double *p, double *c);
int ematwin_begin(void **result, void **raised, const double *c, double *u, double *x);
int ematwin_sample(void **result, void **raised, const double *c, double *x, const double *u,
                   int64_t n, double *y);
int ematwin_advance(void **result, void **raised, const double *c, double *x, const double *u);

static const double at[2] = {AT_COMMAND, AT_LOAD};

static int refuse(Reason *why, const char *text) {
    snprintf(why->text, sizeof why->text, "%s", text);
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

void twin_begin(Twin *twin) {
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

int twin_set(Twin *twin, unsigned reference, double value, Reason *why) {
    if (reference >= VARIABLES) return refuse(why, "There is no variable of this reference.");
    const Variable *one = &variables[reference];
    if (one->role == 'f' && twin->mode > INITIALIZING) {
        snprintf(why->text, sizeof why->text,
                 "%s is fixed: set it before the initialization ends, or reset first.", one->name);
        return -1;
    }
    if (one->role != 'i' && one->role != 'f' && one->role != 't') {
        snprintf(why->text, sizeof why->text, "%s cannot be set.", one->name);
        return -1;
    }
    if (!(value >= one->lower && value <= one->upper)) { /* NaN fails this as well */
        int above = one->lower > 0.0 && one->lower < 1e-300; /* more than zero, as XML has it */
        snprintf(why->text, sizeof why->text,
                 "%s must lie in %s%g, %g]%s%s, received %g; it stays as it was.", one->name,
                 above ? "(" : "[", above ? 0.0 : one->lower, one->upper, *one->unit ? " " : "",
                 one->unit, value);
        return -1;
    }
    if (one->role == 'i') {
        twin->u[reference - FIRST_INPUT] = value;
    } else {
        twin->p[reference - FIRST_PARAMETER] = value;
        twin->changed = 1;
    }
    return 0;
}

int twin_set_rate(Twin *twin, unsigned reference, double value, Reason *why) {
    if (reference >= VARIABLES || variables[reference].role != 'i')
        return refuse(why, "Only inputs have a derivative here.");
    if (!isfinite(value)) return refuse(why, "The derivative of an input must be finite.");
    twin->rate[reference - FIRST_INPUT] = value;
    return 0;
}

int twin_get(Twin *twin, const unsigned references[], size_t count, double values[], Reason *why) {
    double y[OUTPUTS];
    int known = 0;
    for (size_t n = 0; n < count; n++) {
        unsigned reference = references[n];
        if (reference >= VARIABLES) return refuse(why, "There is no variable of this reference.");
        char role = variables[reference].role;
        if (role == 'o' && !known) {
            Twin now = *twin; /* the sample itself is taken when the next step begins */
            if (now.mode <= INITIALIZING) twin_begin(&now);
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

int twin_restore(Twin *twin, const Twin *saved, Reason *why) {
    if (memcmp(saved->token, twin->token, sizeof twin->token) != 0)
        return refuse(why, "The state belongs to another model.");
    *twin = *saved;
    return 0;
}

int twin_save(const void *from, void **state, Reason *why) {
    if (!*state) *state = malloc(sizeof(Twin));
    if (!*state) return refuse(why, "Not enough memory.");
    memcpy(*state, from, sizeof(Twin));
    return 0;
}

int twin_pack(const void *state, void *bytes, size_t size, Reason *why) {
    if (size < sizeof(Twin)) return refuse(why, "There is no room for the state.");
    memcpy(bytes, state, sizeof(Twin));
    return 0;
}

int twin_unpack(const void *bytes, size_t size, void **state, Reason *why) {
    if (size != sizeof(Twin)) return refuse(why, "The state belongs to another model.");
    return twin_save(bytes, state, why);
}

int64_t twin_steps(const Twin *twin, double point, double size, Reason *why) {
    if (twin->mode != RUNNING) return refuse(why, "A step comes after the initialization.");
    double off = (point - twin_time(twin)) / STEP;
    if (!(fabs(off) <= 0.5 + 1e-6)) {
        snprintf(why->text, sizeof why->text,
                 "The communication point must be %.9g s, where the last step ended, received "
                 "%.9g s.",
                 twin_time(twin), point);
        return -1;
    }
    double last = floor((point + size - twin->start) / STEP + 0.5);
    if (!(size >= 0.0 && last < 9e15))
        return refuse(why, "The communication step must be a positive number of seconds.");
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

int twin_finish(Twin *twin, Reason *why) {
    double lost = 0.0;
    inputs(twin, (double)twin->since, (double)twin->since, twin->u);
    twin->rate[0] = twin->rate[1] = 0.0;
    twin->since = 0;
    for (size_t n = 0; n < STATES; n++) lost += 0.0 * twin->x[n];
    return lost == 0.0 ? 0 : refuse(why, "The model diverged: check its parameters and inputs.");
}
