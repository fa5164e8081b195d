/* Quadratic programs over a horizon from a file, solved in turn by the generated code and by HPIPM.
 *
 * program FILE REPEATS MODE MU0 WARM: with WARM above 0, ours begins with the sides in the file, HPIPM with its last solution and
 * that warm_start. One line a problem: iterations, status, cost, CPU time [s] of each (least of the repeats),
 * first those of the generated code. Tolerances of HPIPM are those of the generated code: complementarity so that its
 * sum over all limits is the allowed gap, and so on.
 */
#include <hpipm_d_ocp_qp.h>
#include <hpipm_d_ocp_qp_dim.h>
#include <hpipm_d_ocp_qp_ipm.h>
#include <hpipm_d_ocp_qp_sol.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

/* sizes: defined on the command line: COUNT STATES INPUTS ROWS SOFT LAST_ROWS LAST_SOFT PRODUCTS SIDES NUMBERS LAST_NUMBERS TOLERANCE; the soft rows
 * come first */
extern int gt_qp_solve(const double *at, double *inputs, const double *data, const double *last, const double *start,
                       double *states, double *kept, double *found);

#define OF_STAGE ((STATES * STATES) + (STATES * INPUTS) + STATES + (STATES * STATES) + (INPUTS * STATES) + (INPUTS * INPUTS) + STATES + INPUTS + (ROWS * (STATES + INPUTS)) + (2 * ROWS) + (2 * SOFT))
#define AT_END ((STATES * STATES) + STATES + (LAST_ROWS * STATES) + (2 * LAST_ROWS) + (2 * LAST_SOFT))

static double begin[SIDES], data[COUNT * NUMBERS + 1], last[LAST_NUMBERS + 1], stage[COUNT][OF_STAGE], end[AT_END], x0[STATES], constant;

static double seconds(void)
{
    struct timespec t;

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + (1e-9 * (double)t.tv_nsec);
}

static void read_numbers(double *to, size_t n, FILE *f)
{
    if (fread(to, sizeof(double), n, f) != n) {
        exit(2);
    }
}

static void limited(struct d_ocp_qp *qp, int k, double *a, int rows, int soft)
{
    static int first[ROWS + 1];
    double *high = &a[rows];
    double *price = &a[2 * rows];
    double zero[ROWS + 1] = {0.0};
    int j;

    for (j = 0; j < soft; j++) {
        first[j] = j + ((k == 0) ? STATES : 0);
    }
    d_ocp_qp_set_lg(k, a, qp);
    d_ocp_qp_set_ug(k, high, qp);
    d_ocp_qp_set_idxs(k, first, qp);
    d_ocp_qp_set_zl(k, price, qp);
    d_ocp_qp_set_zu(k, price, qp);
    d_ocp_qp_set_Zl(k, &price[soft], qp);
    d_ocp_qp_set_Zu(k, &price[soft], qp);
    d_ocp_qp_set_lls(k, zero, qp);
    d_ocp_qp_set_lus(k, zero, qp);
}

int main(int argc, char **argv)
{
    FILE *f = fopen(argv[1], "rb");
    const int repeats = atoi(argv[2]);
    const int mode = atoi(argv[3]);
    double mu0 = atof(argv[4]);
    int warm = (argc > 5) ? atoi(argv[5]) : 0;
    const double rest[STATES + INPUTS] = {0.0};
    static double states[(COUNT + 1) * STATES], inputs[COUNT * INPUTS], kept[SIDES];
    int nx[COUNT + 1], nu[COUNT + 1], nbx[COUNT + 1] = {0}, nbu[COUNT + 1] = {0}, ng[COUNT + 1], ns[COUNT + 1];
    int fixed[STATES];
    int started = 0;
    int k;
    int r;
    double total;
    struct d_ocp_qp_dim dim;
    struct d_ocp_qp qp;
    struct d_ocp_qp_sol sol;
    struct d_ocp_qp_ipm_arg arg;
    struct d_ocp_qp_ipm_ws ws;

    if ((argc != 6) || (f == 0)) {
        return 2;
    }
    for (k = 0; k <= COUNT; k++) {
        nx[k] = STATES;
        nu[k] = (k < COUNT) ? INPUTS : 0;
        ng[k] = (k < COUNT) ? ROWS : LAST_ROWS;
        ns[k] = (k < COUNT) ? SOFT : LAST_SOFT;
    }
    nbx[0] = STATES;
    for (k = 0; k < STATES; k++) {
        fixed[k] = k;
    }
    d_ocp_qp_dim_create(COUNT, &dim, malloc(d_ocp_qp_dim_memsize(COUNT)));
    d_ocp_qp_dim_set_all(nx, nu, nbx, nbu, ng, ns, &dim);
    d_ocp_qp_dim_set_nbxe(0, STATES, &dim);
    d_ocp_qp_create(&dim, &qp, malloc(d_ocp_qp_memsize(&dim)));
    d_ocp_qp_sol_create(&dim, &sol, malloc(d_ocp_qp_sol_memsize(&dim)));
    d_ocp_qp_ipm_arg_create(&dim, &arg, malloc(d_ocp_qp_ipm_arg_memsize(&dim)));
    d_ocp_qp_ipm_arg_set_default((enum hpipm_mode)mode, &arg);
    d_ocp_qp_sol_set_zero(&sol);
    d_ocp_qp_ipm_ws_create(&dim, &arg, &ws, malloc(d_ocp_qp_ipm_ws_memsize(&dim, &arg)));
    while (fread(x0, sizeof(double), STATES, f) == STATES) {
        double found[5], least[2] = {1e9, 1e9}, allowed, tolerance, cost;
        int status[2], iterations, most = 60;

        read_numbers(data, COUNT * NUMBERS, f);
        read_numbers(last, LAST_NUMBERS, f);
        read_numbers(&constant, 1, f);
        read_numbers(begin, SIDES, f);
        for (k = 0; k < COUNT; k++) {
            double *a = stage[k];

            read_numbers(a, OF_STAGE, f);
            d_ocp_qp_set_A(k, a, &qp);
            d_ocp_qp_set_B(k, a += STATES * STATES, &qp);
            d_ocp_qp_set_b(k, a += STATES * INPUTS, &qp);
            d_ocp_qp_set_Q(k, a += STATES, &qp);
            d_ocp_qp_set_S(k, a += STATES * STATES, &qp);
            d_ocp_qp_set_R(k, a += INPUTS * STATES, &qp);
            d_ocp_qp_set_q(k, a += INPUTS * INPUTS, &qp);
            d_ocp_qp_set_r(k, a += STATES, &qp);
            d_ocp_qp_set_C(k, a += INPUTS, &qp);
            d_ocp_qp_set_D(k, a += ROWS * STATES, &qp);
            limited(&qp, k, a + (ROWS * INPUTS), ROWS, SOFT);
        }
        read_numbers(end, AT_END, f);
        d_ocp_qp_set_Q(COUNT, end, &qp);
        d_ocp_qp_set_q(COUNT, &end[STATES * STATES], &qp);
        d_ocp_qp_set_C(COUNT, &end[(STATES * STATES) + STATES], &qp);
        limited(&qp, COUNT, &end[(STATES * STATES) + STATES + (LAST_ROWS * STATES)], LAST_ROWS, LAST_SOFT);
        d_ocp_qp_set_idxbx(0, fixed, &qp);
        d_ocp_qp_set_idxbxe(0, fixed, &qp);
        d_ocp_qp_set_lbx(0, x0, &qp);
        d_ocp_qp_set_ubx(0, x0, &qp);
        for (r = 0; r < repeats; r++) {
            double begun;

            for (k = 0; k < COUNT * INPUTS; k++) {
                inputs[k] = 0.0;
            }
            begun = seconds();
            status[0] = gt_qp_solve(x0, inputs, data, last, (warm > 0) ? begin : 0, states, kept, found);
            least[0] = fmin(least[0], seconds() - begun);
            allowed = TOLERANCE * (1.0 + fabs(found[0]));
            tolerance = allowed / PRODUCTS;
            d_ocp_qp_ipm_arg_set_tol_comp(&tolerance, &arg);
            tolerance = TOLERANCE / PRODUCTS;
            d_ocp_qp_ipm_arg_set_tol_ineq(&tolerance, &arg);
            d_ocp_qp_ipm_arg_set_tol_eq(&tolerance, &arg);
            tolerance = 10.0 * allowed / (COUNT * INPUTS);
            d_ocp_qp_ipm_arg_set_tol_stat(&tolerance, &arg);
            tolerance = 1e300;
            d_ocp_qp_ipm_arg_set_tol_dual_gap(&tolerance, &arg);
            d_ocp_qp_ipm_arg_set_iter_max(&most, &arg);
            if (mu0 > 0.0) {
                d_ocp_qp_ipm_arg_set_mu0(&mu0, &arg);
            }
            k = (started > 0) ? warm : 0;
            d_ocp_qp_ipm_arg_set_warm_start(&k, &arg);
            for (k = 0; k <= COUNT; k++) { /* the unknowns are changes of the plan */
                d_ocp_qp_sol_set_x(k, (double *)rest, &sol);
                if (k < COUNT) {
                    d_ocp_qp_sol_set_u(k, (double *)rest, &sol);
                }
            }
            begun = seconds();
            d_ocp_qp_ipm_solve(&qp, &sol, &arg, &ws);
            least[1] = fmin(least[1], seconds() - begun);
        }
        d_ocp_qp_ipm_get_status(&ws, &status[1]);
        started = (status[1] == 0) ? 1 : 0;
        d_ocp_qp_ipm_get_iter(&ws, &iterations);
        cost = constant;
        for (k = 0; k <= COUNT; k++) { /* cost of HPIPM's solution, with the prices of what its rows exceed */
            double *a = (k < COUNT) ? stage[k] : end;
            const int m = (k < COUNT) ? INPUTS : 0;
            const int rows = (k < COUNT) ? ROWS : LAST_ROWS;
            const int soft = (k < COUNT) ? SOFT : LAST_SOFT;
            const double *Q = (k < COUNT) ? &a[(STATES * STATES) + (STATES * INPUTS) + STATES] : a;
            const double *S = &Q[STATES * STATES], *R = &S[INPUTS * STATES];
            const double *q = (k < COUNT) ? &R[INPUTS * INPUTS] : &a[STATES * STATES];
            const double *c = (k < COUNT) ? &q[STATES + INPUTS] : &q[STATES];
            const double *d = &c[rows * STATES], *low = &d[rows * m], *price = &low[2 * rows];
            double x[STATES], u[INPUTS];
            int i;
            int j;

            d_ocp_qp_sol_get_x(k, &sol, x);
            if (m > 0) {
                d_ocp_qp_sol_get_u(k, &sol, u);
            }
            for (i = 0; i < STATES; i++) {
                cost += q[i] * x[i];
                for (j = 0; j < STATES; j++) {
                    cost += 0.5 * x[i] * Q[i + (STATES * j)] * x[j];
                }
                for (j = 0; j < m; j++) {
                    cost += u[j] * S[j + (INPUTS * i)] * x[i];
                }
            }
            for (i = 0; i < m; i++) {
                cost += q[STATES + i] * u[i];
                for (j = 0; j < m; j++) {
                    cost += 0.5 * u[i] * R[i + (INPUTS * j)] * u[j];
                }
            }
            for (i = 0; i < soft; i++) {
                double y = 0.0;
                double e;

                for (j = 0; j < STATES; j++) {
                    y += c[i + (rows * j)] * x[j];
                }
                for (j = 0; j < m; j++) {
                    y += d[i + (rows * j)] * u[j];
                }
                e = fmax(fmax(low[i] - y, y - low[rows + i]), 0.0);
                cost += (price[i] * e) + (0.5 * price[soft + i] * e * e);
            }
        }
        total = cost;
        printf("%d %d %.17g %.9g %d %d %.17g %.9g\n", (int)found[4], status[0], found[0], least[0], iterations, status[1],
               total, least[1]);
    }
    return 0;
}
