/* gt_l1: results of Python with all their bits, and the comparison with them. */
#include "gt_l1.h"

#include "gt_l1_body.h"
#include "gt_compare.h"
#include "gt_guard.h"

#include <math.h>

/* What stands in the outputs before a call, and after one that fails. */
#define GT_HELD (-1.25e+300)

static const double fk_inputs[17][3] = {
    {-0x1.af23ecf0130fdp-1, -0x1.08829a2dd0327p+0, -0x1.8d4441a1b1538p-1},
    {-0x1.0c51c602026b1p-1, -0x1.adc5355c14f76p-2, 0x1.38e8a7e39eca1p-5},
    {-0x1.22b210f368a8ap-1, -0x1.79e273b37bc97p-2, 0x1.3680f78f38b11p-9},
    {-0x1.96ceb7eedfd6ep-1, -0x1.1baa728aebdb6p-1, -0x1.0fa337a1d6851p-2},
    {-0x1.54e78a9b5202ap+1, -0x1.a920b2dee6400p+1, -0x1.8e1307d98bf32p+1},
    {-0x1.5eeaf2b2d99d9p-1, 0x1.7d915ed004080p-1, 0x1.7b1b6fb1676d0p-4},
    {0x1.e7208ea1139fcp-3, -0x1.0e8a472530856p-3, 0x1.94cb697693d51p-1},
    {-0x1.372c0985fd78ap+0, -0x1.66bf93ac62f85p-1, -0x1.718ac39361f0dp-3},
    {-0x1.3ce2fbac97c33p-1, -0x1.1f4b5d711f7bep+0, -0x1.51562d196926ep+1},
    {-0x1.95e7ceec5009dp-1, -0x1.1ce5e38245660p-1, -0x1.fe668e74d4f87p-3},
    {-0x1.12ca5a41ec7bcp-1, -0x1.7b49475d7efb6p-2, -0x1.39c834fa636f0p-6},
    {-0x1.07b89ef6ab0f2p-1, -0x1.1e64ce07b7712p+1, -0x1.5ac0fd977a11cp-2},
    {-0x1.97a9ff4668c2ep-2, -0x1.152853e0ace26p+2, -0x1.2ea1cc39a3177p+2},
    {-0x1.1a3303fdde1f2p+0, -0x1.d6c0e81a0b1b8p+0, -0x1.264793c91fe3ep+2},
    {0x1.cb826031dd548p+1, -0x1.4ffeb7f3f879ap-2, 0x1.e34d57d5f0206p+0},
    {NAN, -0x1.08829a2dd0327p+0, -0x1.8d4441a1b1538p-1},
    {-0x1.af23ecf0130fdp-1, -0x1.08829a2dd0327p+0, INFINITY}
};

static const double fk_outputs[17][3] = {
    {0x1.5babcb2be853dp-1, -0x1.fa7c47b2bbc4bp-1, 0x1.b333c936da66cp-2},
    {0x1.6ea0c8afa4391p+0, -0x1.28b54eb5351d4p-1, 0x1.ff47bc321e354p-1},
    {0x1.6d2b9740b3179p+0, -0x1.d23fc1e45462cp-2, 0x1.052b1df4e5aacp+0},
    {0x1.33863d28c8aafp+0, -0x1.a088861279226p-2, 0x1.f5a158f39e5b8p-1},
    {-0x1.e5771c4ed2adcp+0, -0x1.574c2e033b590p+0, 0x1.207b9ab909a40p-4},
    {0x1.572ea953833eep+0, 0x1.d8c348f52022cp-2, 0x1.3a1a6b0514c53p+0},
    {0x1.d548df950e061p+0, -0x1.3411e4e60aca1p+0, 0x1.b8c1a54b01a58p-1},
    {0x1.bf26d2f2a73d8p-1, -0x1.f62888de51330p-5, 0x1.7867d2f7e8178p+0},
    {-0x1.1d853405b5352p+0, -0x1.de55b54521bf8p-1, -0x1.376bcf2eca4b4p-2},
    {0x1.34b2e65ee130ep+0, -0x1.a4378a391002ep-2, 0x1.fd8d2a09b5ed3p-1},
    {0x1.6e7ebb281b075p+0, -0x1.0135b943a349cp-1, 0x1.ead2c1d631e50p-1},
    {-0x1.2e051cf32ed52p-1, -0x1.c06385c6a4851p+0, 0x1.862222e461198p-2},
    {GT_HELD, GT_HELD, GT_HELD},
    {GT_HELD, GT_HELD, GT_HELD},
    {GT_HELD, GT_HELD, GT_HELD},
    {GT_HELD, GT_HELD, GT_HELD},
    {GT_HELD, GT_HELD, GT_HELD}
};

static const gt_status fk_status[17] = {GT_OK, GT_OK, GT_OK, GT_OK, GT_OK, GT_OK, GT_OK, GT_OK, GT_OK, GT_OK, GT_OK, GT_OK, GT_OUT_OF_RANGE, GT_OUT_OF_RANGE, GT_OUT_OF_RANGE, GT_NOT_FINITE, GT_NOT_FINITE};

static int fk_failures(double *worst)
{
    const int rows = (int)(sizeof(fk_status) / sizeof(fk_status[0]));
    int failures = 0;
    int row;

    for (row = 0; row < rows; row++) {
        gt_l1_fk_in in;
        gt_l1_fk_out out;
        int good = 1;

        gt_copy(in.q_m, &fk_inputs[row][0], 3);
        out.T_m[0] = GT_HELD;
        out.T_m[1] = GT_HELD;
        out.T_m[2] = GT_HELD;
        good &= (gt_l1_fk(&in, &out) == fk_status[row]) ? 1 : 0;
        good &= gt_all_equal(out.T_m, &fk_outputs[row][0], 3, worst);
        failures += (good != 0) ? 0 : 1;
    }
    return failures;
}

static const double fk_body_given[3][3] = {
    {-0x1.af23ecf0130fdp-1, -0x1.08829a2dd0327p+0, -0x1.8d4441a1b1538p-1},
    {-0x1.0c51c602026b1p-1, -0x1.adc5355c14f76p-2, 0x1.38e8a7e39eca1p-5},
    {-0x1.22b210f368a8ap-1, -0x1.79e273b37bc97p-2, 0x1.3680f78f38b11p-9}
};

static const double fk_body_found[3][5] = {
    {0x1.5babcb2be853dp-1, -0x1.fa7c47b2bbc4bp-1, 0x1.b333c936da66cp-2, 0x1.dda26b4d2dd76p+6, 0x1.c7bc9923ad9fbp+5},
    {0x1.6ea0c8afa4391p+0, -0x1.28b54eb5351d4p-1, 0x1.ff47bc321e354p-1, 0x1.2893c5ebe5a72p+7, 0x1.0f6da043bcb29p+6},
    {0x1.6d2b9740b3179p+0, -0x1.d23fc1e45462cp-2, 0x1.052b1df4e5aacp+0, 0x1.37e9442787260p+7, 0x1.1996aee54b46bp+6}
};

static int fk_body_differences(double *worst)
{
    const double *arg[GT_L1_FK_SZ_ARG + 1]; /* + 1: C knows no empty array */
    double *res[GT_L1_FK_SZ_RES + 1];
    long long int iw[GT_L1_FK_SZ_IW + 1];
    double w[GT_L1_FK_SZ_W + 1];
    double y[5];
    int failures = 0;
    int row;

    for (row = 0; row < 3; row++) {
        arg[0] = &fk_body_given[row][0];
        res[0] = &y[0];
        res[1] = &y[3];
        (void)gt_l1_fk_body(arg, res, iw, w, 0);
        failures += (gt_all_equal(y, fk_body_found[row], 5, worst) != 0) ? 0 : 1;
    }
    return failures;
}

static int total(double *worst)
{
    int failures = 0;

    failures += fk_failures(worst);
    failures += fk_body_differences(worst);
    return failures;
}

int gt_l1_selftest(void)
{
    double worst = 0.0;

    return total(&worst);
}

double gt_l1_selftest_difference(void)
{
    double worst = 0.0;

    (void)total(&worst);
    return worst;
}
