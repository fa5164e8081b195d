/* A synthetic unit for co-simulation that misbehaves as its input `how` says, in the step that begins at `when`: FMI 2.0
   and 3.0, by -DVERSION. Its carts follow their commands, position += 0.5 * (command - position) in a step. */
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { GOOD, ABORTS, EXITS, CRASHES, HANGS, PRINTS, ASKS_TO_END, WANTS_EVENT, ELSEWHERE, NO_NUMBER, DISCARDS, SCRIBBLES,
       STAYS };
enum { HOW, CODE, WHEN, COMMAND, POSITION = 6, TIME = 9, SIZE };
typedef void *Any;
typedef struct {
    double x[SIZE], time;
#if VERSION == 2
    void (*log)(Any, const char *, int, const char *, const char *, ...);
#else
    void (*log)(Any, int, const char *, const char *);
#endif
} Unit;

static Unit *made(void) {
    Unit *u = calloc(1, sizeof(Unit));
    u->x[WHEN] = -1.0;
    return u;
}
static void say(Unit *u, int status, const char *text) {
#if VERSION == 2
    if (u->log) u->log(NULL, "wild", status, "log", "%s of %d", text, (int)u->x[CODE]);
#else
    if (u->log) u->log(NULL, status, "log", text);
#endif
}
static int wild(Unit *u, double t, int *ends, int *event, double *last) {
    if (u->x[WHEN] > t + 1e-9 || u->x[WHEN] < -0.5) return 0;
    switch ((int)u->x[HOW]) {
    case ABORTS: say(u, 0, "no licence"); abort();
    case EXITS: say(u, 1, "no licence"); exit((int)u->x[CODE]);
    case CRASHES: raise(SIGSEGV); break;
    case HANGS: for (;;) sleep(1);
    case PRINTS: printf("{\"I am\": \"no JSON\"}\n"); fflush(stdout); fprintf(stderr, "nor I\n"); printf("late"); break;
    case ASKS_TO_END: *ends = 1; return VERSION == 2 ? 2 : 0;
    case WANTS_EVENT: *event = 1; break;
    case ELSEWHERE: *last = u->x[CODE]; break;
    case NO_NUMBER: u->x[POSITION] = 0.0 / 0.0; break;
    case DISCARDS: say(u, 2, "\033[31m far\007\n off \377"); return 2;
    case SCRIBBLES: for (int n = 3; n < 4096; n++) (void)!write(n, "\1\0\0\0?", 5); for (;;) sleep(1);
    }
    return 0;
}
static int step(Unit *u, double t, double h, int *ends, int *event, double *last) {
    *last = t + h;
    for (int k = 0; k < 3; k++) u->x[POSITION + k] += 0.5 * (u->x[COMMAND + k] - u->x[POSITION + k]);
    return wild(u, t, ends, event, last);
}
static int get(Unit *u, const unsigned *r, size_t n, double *x) {
    for (size_t k = 0; k < n; k++) x[k] = u->x[r[k]];
    return 0;
}
static int set(Unit *u, const unsigned *r, size_t n, const double *x) {
    for (size_t k = 0; k < n; k++) u->x[r[k]] = x[k];
    return 0;
}
static int reset(Unit *u) { if (u->x[HOW] == STAYS) return 3; memset(u->x, 0, sizeof u->x); return 0; }

#if VERSION == 2
typedef struct { void (*log)(Any, const char *, int, const char *, const char *, ...); } Callbacks;
static int ended;
Any fmi2Instantiate(const char *n, int k, const char *g, const char *r, const Callbacks *c, int v, int on) {
    Unit *u = made();
    u->log = c->log;
    return u;
}
int fmi2SetupExperiment(Any u, int d, double t, double b, int s, double e) { return 0; }
int fmi2EnterInitializationMode(Any u) { return 0; }
int fmi2SetReal(Any u, const unsigned *r, size_t n, const double *x) { return set(u, r, n, x); }
int fmi2GetReal(Any u, const unsigned *r, size_t n, double *x) { return get(u, r, n, x); }
int fmi2DoStep(Any u, double t, double h, int no) {
    int event = 0;
    double last;
    return step(u, t, h, &ended, &event, &last);
}
int fmi2GetBooleanStatus(Any u, int kind, int *x) { *x = ended; return 0; }
int fmi2ExitInitializationMode(Any u) { int e = 0; double l; return ((Unit *)u)->x[WHEN] == 0.0 ? wild(u, 0.0, &e, &e, &l) : 0; }
int fmi2Reset(Any u) { return reset(u); }
void fmi2FreeInstance(Any u) { free(u); }
#else
Any fmi3InstantiateCoSimulation(const char *n, const char *t, const char *r, bool v, bool l, bool m, bool a,
                                const unsigned *q, size_t k, Any e, void (*log)(Any, int, const char *, const char *), Any w) {
    Unit *u = made();
    u->log = log;
    return u;
}
int fmi3EnterInitializationMode(Any u, bool d, double t, double b, bool s, double e) { return 0; }
int fmi3SetFloat64(Any u, const unsigned *r, size_t n, const double *x, size_t m) { return set(u, r, n, x); }
int fmi3GetFloat64(Any u, const unsigned *r, size_t n, double *x, size_t m) { return get(u, r, n, x); }
int fmi3DoStep(Any u, double t, double h, bool no, bool *event, bool *ends, bool *early, double *last) {
    int e = 0, v = 0, status = step(u, t, h, &e, &v, last);
    *ends = e;
    *event = v;
    *early = false;
    return status;
}
int fmi3ExitInitializationMode(Any u) { int e = 0; double l; return ((Unit *)u)->x[WHEN] == 0.0 ? wild(u, 0.0, &e, &e, &l) : 0; }
int fmi3Reset(Any u) { return reset(u); }
void fmi3FreeInstance(Any u) { free(u); }
#endif
