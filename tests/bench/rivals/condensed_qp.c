/* Quadratic programs in the inputs alone from a file, solved by DAQP's C as its user would: factorise, then solve.
 *
 * program FILE WARM: for each problem n, m, simple bounds, then H, f, A, upper, lower; one line each: status (1: solved),
 * iterations, cost, CPU time of both steps and of the solution alone [s], then the solution. WARM: it begins with the active
 * set of the problem before.
 */
#include <daqp/api.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static double seconds(void)
{
    struct timespec t;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + (1e-9 * (double)t.tv_nsec);
}

static double *numbers(size_t n, FILE *f)
{
    double *a = malloc((n + 1) * sizeof(double));

    if (fread(a, sizeof(double), n, f) != n) {
        exit(2);
    }
    return a;
}

int main(int argc, char **argv)
{
    FILE *f = fopen(argv[1], "rb");
    int *sense = 0;
    int before = 0;
    double size[3];

    if ((argc != 3) || (f == 0)) {
        return 2;
    }
    while (fread(size, sizeof(double), 3, f) == 3) {
        const int n = (int)size[0], m = (int)size[1], simple = (int)size[2];
        DAQPProblem qp = {n, m, simple, 0, 0, 0, 0, 0, 0};
        DAQPWorkspace work;
        DAQPResult found;
        double begun, factorised, ended;
        int k;

        memset(&work, 0, sizeof work);
        memset(&found, 0, sizeof found);
        qp.H = numbers((size_t)n * (size_t)n, f);
        qp.f = numbers((size_t)n, f);
        qp.A = numbers((size_t)n * (size_t)(m - simple), f);
        qp.bupper = numbers((size_t)m, f);
        qp.blower = numbers((size_t)m, f);
        if ((sense == 0) || (before != m) || (atoi(argv[2]) == 0)) {
            free(sense);
            sense = calloc((size_t)m + 1, sizeof(int));
        }
        before = m;
        qp.sense = sense;
        found.x = calloc((size_t)n, sizeof(double));
        found.lam = calloc((size_t)m, sizeof(double));
        begun = seconds();
        found.exitflag = setup_daqp(&qp, &work, 0);
        factorised = seconds();
        if (found.exitflag >= 0) {
            daqp_solve(&found, &work);
        }
        ended = seconds();
        printf("%d %d %.17g %.9g %.9g", found.exitflag, found.iter, found.fval, ended - begun, ended - factorised);
        for (k = 0; k < n; k++) {
            printf(" %.17g", found.x[k]);
        }
        printf("\n");
        for (k = 0; k < m; k++) {
            sense[k] = (found.lam[k] != 0.0) ? ((found.lam[k] < 0.0) ? 3 : 1) : 0;
        }
        free(qp.H);
        free(qp.f);
        free(qp.A);
        free(qp.bupper);
        free(qp.blower);
        free(found.x);
        free(found.lam);
        if (work.settings != 0) {
            free_daqp_workspace(&work);
            free_daqp_ldp(&work);
        }
    }
    return 0;
}
