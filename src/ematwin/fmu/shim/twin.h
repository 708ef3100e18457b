/* An actuator sample by sample: what both versions of FMI are a layer on. */
#ifndef TWIN_H
#define TWIN_H

#include <stddef.h>
#include <stdint.h>

#include "model.h" /* written by the export: sizes, steps and variables of this actuator */

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status; /* as both versions number it */

enum Mode { INSTANTIATED, INITIALIZING, RUNNING, ENDED };

/* All that an instance remembers, without a pointer in it: a copy is a saved state. */
typedef struct {
    char token[40]; /* of the model that it belongs to */
    enum Mode mode;
    int changed;    /* parameters differ from those of the constants */
    int64_t steps;  /* done since the start */
    int64_t since;  /* done in this communication step */
    double start;   /* s */
    double p[PARAMETERS], c[CONSTANTS], x[STATES];
    double u[2], rate[2]; /* inputs at the communication point, and their change a second */
    double y[OUTPUTS];    /* of the last sample that is over */
    char why[400];        /* the last call that gave -1 was refused */
} Twin;

void twin_reset(Twin *twin);
double twin_time(const Twin *twin);

/* These give 0, or -1 and a reason in `why`. */
int twin_refuse(Twin *twin, const char *format, ...);
int twin_enter_initialization(Twin *twin, double start);
int twin_exit_initialization(Twin *twin);
int twin_set(Twin *twin, unsigned reference, double value);
int twin_set_rate(Twin *twin, unsigned reference, double value);
int twin_get(Twin *twin, const unsigned references[], size_t count, double values[]);
int twin_restore(Twin *twin, const Twin *saved);
/* Copies of a state: to memory that is found where it is needed, to bytes, and from bytes. */
int twin_save(Twin *twin, const void *from, void **state);
int twin_pack(Twin *twin, const void *state, void *bytes, size_t size);
int twin_unpack(Twin *twin, const void *bytes, size_t size, void **state);

/* Steps of a communication step; -1 and a reason if there is no such step. */
int64_t twin_steps(Twin *twin, double point, double size);
void twin_advance(Twin *twin);
/* The communication step is over: inputs stay where their rates led. */
int twin_finish(Twin *twin);

#endif
