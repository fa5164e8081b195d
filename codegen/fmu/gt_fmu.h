/* One instance of a functional mock-up unit, whatever the version of its interface: values by value reference, modes,
 * the step inside of co-simulation. gt_fmu3.c and gt_fmu2.c give it the names of the standard; gt_fmu_model.c, which is
 * generated, the tables and the equations.
 */
#ifndef GT_FMU_H
#define GT_FMU_H

#include "gt_fmu_model.h"
#include "gt_status.h"

#include <float.h>
#include <stddef.h>

/* What a call ends with; the numbers are those of FMI 2 and 3. */
typedef enum gt_fmu_result { GT_FMU_OK = 0, GT_FMU_WARNING = 1, GT_FMU_DISCARD = 2, GT_FMU_ERROR = 3 } gt_fmu_result;

/* A set of modes is a sum of these. */
typedef enum gt_fmu_mode {
    GT_FMU_INSTANTIATED = 1,
    GT_FMU_INITIALIZATION = 2,
    GT_FMU_EVENT = 4,
    GT_FMU_CONTINUOUS = 8,
    GT_FMU_STEPPING = 16,
    GT_FMU_TERMINATED = 32
} gt_fmu_mode;

#define GT_FMU_BEFORE (GT_FMU_INSTANTIATED + GT_FMU_INITIALIZATION)
#define GT_FMU_RUNNING (GT_FMU_EVENT + GT_FMU_CONTINUOUS + GT_FMU_STEPPING)

/* All that a run changes, without pointers: the state that is saved, restored and serialised. */
typedef struct gt_fmu_data {
    double v[GT_FMU_REALS]; /* by value reference, time first */
    int n[GT_FMU_INTEGERS + 1];
    gt_fmu_memory kept;  /* what is remembered at the last completed step */
    gt_fmu_memory tried; /* the same behind the last evaluation */
    double began;        /* start time */
    double stop;         /* stop time, DBL_MAX where there is none */
    double reached;      /* lastSuccessfulTime of FMI 2 */
    long long samples;   /* taken so far */
    int stuck;           /* not even one part of the last step went well */
    int stale;           /* outputs are older than what they are computed from */
    int mode;
    int last; /* gt_status of the last evaluation */
} gt_fmu_data;

typedef struct gt_fmu gt_fmu;
typedef void (*gt_fmu_say)(const gt_fmu *f, gt_fmu_result result, const char *sentence);

struct gt_fmu {
    gt_fmu_data data;
    int co_simulation;
    int logging;   /* of discarded calls; errors are always said */
    gt_fmu_say say; /* always there */
    void (*logger)(void);
    void *environment;
    void (*release)(void *memory);
    char *name;
};

/* Values as after instantiation. */
void gt_fmu_reset(gt_fmu *f);
/* An experiment from a start time to a stop time, DBL_MAX where there is none. */
gt_fmu_result gt_fmu_set_experiment(gt_fmu *f, double start, double stop, const char *call);
gt_fmu_result gt_fmu_enter_initialization(gt_fmu *f, double start);
gt_fmu_result gt_fmu_exit_initialization(gt_fmu *f);
/* From one of the modes `from` to another; GT_FMU_ERROR from elsewhere. */
gt_fmu_result gt_fmu_change(gt_fmu *f, int from, gt_fmu_mode to, const char *call);
/* GT_FMU_ERROR unless the instance is in one of the modes. */
gt_fmu_result gt_fmu_in(const gt_fmu *f, int modes, const char *call);

gt_fmu_result gt_fmu_get(gt_fmu *f, const unsigned int *references, size_t n, double *values);
gt_fmu_result gt_fmu_set(gt_fmu *f, const unsigned int *references, size_t n, const double *values);
gt_fmu_result gt_fmu_get_integers(gt_fmu *f, const unsigned int *references, size_t n, int *values);
gt_fmu_result gt_fmu_set_integers(gt_fmu *f, const unsigned int *references, size_t n, const int *values);

gt_fmu_result gt_fmu_set_time(gt_fmu *f, double time);
gt_fmu_result gt_fmu_set_states(gt_fmu *f, const double *x, size_t n);
gt_fmu_result gt_fmu_get_states(const gt_fmu *f, double *x, size_t n);
gt_fmu_result gt_fmu_get_derivatives(gt_fmu *f, double *dx, size_t n);
gt_fmu_result gt_fmu_get_nominals(const gt_fmu *f, double *x, size_t n);
/* What a solver has accepted becomes what is remembered. */
gt_fmu_result gt_fmu_completed(gt_fmu *f);
/* Takes the sample that is due; the time of the next one, where there are samples. */
gt_fmu_result gt_fmu_update(gt_fmu *f, int *defined, double *next);

/* Goes on from `from` by h; *reached is the end of the last part that succeeded. Where it is GT_FMU_DISCARD the state is
 * the one at *reached. */
gt_fmu_result gt_fmu_advance(gt_fmu *f, double from, double h, double *reached);

/* Of unknowns (computed) by knowns, along a seed, or, where adjoint, against one. */
gt_fmu_result gt_fmu_slope(gt_fmu *f, const unsigned int *unknowns, size_t n, const unsigned int *knowns, size_t m,
                           const double *seed, double *result, int adjoint);

/* Back to a saved state; GT_FMU_ERROR, and nothing is changed, for one of model exchange in co-simulation or the other
 * way round. */
gt_fmu_result gt_fmu_restore(gt_fmu *f, const gt_fmu_data *data);

/* A state as bytes: its size, there and back. Bytes of another model, or broken ones, give GT_FMU_ERROR. */
size_t gt_fmu_bytes(void);
void gt_fmu_pack(const gt_fmu_data *data, unsigned char *bytes);
gt_fmu_result gt_fmu_unpack(const gt_fmu *f, const unsigned char *bytes, size_t n, gt_fmu_data *data);

/* Turns log categories on or off; all where n is 0. */
gt_fmu_result gt_fmu_log(gt_fmu *f, int on, size_t n, const char *const *categories);
/* Whether a call that ends so is said. */
int gt_fmu_is_said(const gt_fmu *f, gt_fmu_result result);
#ifdef GT_FMU_PARAMETERS
/* Whether a number is between the limits of the parameter of the model that it is set to; of others: yes. */
int gt_fmu_within(unsigned int reference, double value);
#endif /* GT_FMU_PARAMETERS */
/* Says a sentence, with the name of the call. */
gt_fmu_result gt_fmu_refuse(const gt_fmu *f, gt_fmu_result result, const char *call, const char *sentence);
/* A copy of a text; 0 without memory. */
char *gt_fmu_copied(const char *text, void *(*allocate)(size_t, size_t));

#endif
