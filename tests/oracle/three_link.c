#include "three_link.h"

#include <math.h>

/* The links at a pose, one entry per arm: (dx, dy, dz) of (6.4), and y = dy/dx, z = dz/dx of (6.5). */
typedef struct {
    double dx[3];
    double y[3];
    double z[3];
} links;

static inline double square(double x)
{
    return x * x;
}

/* Links from the plate's position; dx > 0 by (6.3). */
static inline void links_of_plate(const three_link *robot, const double T[3], links *k)
{
    for (int i = 0; i < 3; i++) {
        const double dy = T[1] - robot->A[i][1];
        const double dz = T[2] - robot->A[i][2];
        k->dx[i] = sqrt(square(robot->L[i]) - square(dy) - square(dz));
        k->y[i] = dy / k->dx[i];
        k->z[i] = dz / k->dx[i];
    }
}

/* qd = J^-1 Td with J^-1 of (6.5). */
static inline void cart_velocity(const links *k, const double Td[3], double qd[3])
{
    for (int i = 0; i < 3; i++) {
        qd[i] = Td[0] + k->y[i] * Td[1] + k->z[i] * Td[2];
    }
}

/* The last column of (6.6) over dx: qdd = J^-1 Tdd + c, because the rows of J^-1 are those of its matrix over dx. */
static inline void centripetal(const links *k, const double Td[3], const double qd[3], double c[3])
{
    const double across = square(Td[1]) + square(Td[2]);
    for (int i = 0; i < 3; i++) {
        c[i] = (square(Td[0] - qd[i]) + across) / k->dx[i];
    }
}

static double smooth_sign(three_link_friction law, double ratio)
{
    if (law == THREE_LINK_TANH) {
        return tanh(ratio);
    }
    if (law == THREE_LINK_PIECEWISE_LINEAR) {
        return ratio < -1.0 ? -1.0 : ratio > 1.0 ? 1.0 : ratio;
    }
    return ratio < 0.0 ? -1.0 : ratio > 0.0 ? 1.0 : 0.0;
}

/* What (6.8) takes from the motor forces. */
static inline void friction(const three_link *robot, three_link_friction law, const double qd[3], double f[3])
{
    for (int i = 0; i < 3; i++) {
        f[i] = robot->coulomb[i] * smooth_sign(law, qd[i] / robot->velocity_scale) + robot->viscous[i] * qd[i];
    }
}

/* Solve [1 1 1; y; z] f = b, the transposed system of (6.7), by subtracting its first row. */
static inline void forces_on_carts(const links *k, const double b[3], double f[3])
{
    const double y1 = k->y[1] - k->y[0], y2 = k->y[2] - k->y[0], by = b[1] - k->y[0] * b[0];
    const double z1 = k->z[1] - k->z[0], z2 = k->z[2] - k->z[0], bz = b[2] - k->z[0] * b[0];
    const double determinant = y1 * z2 - y2 * z1;
    f[1] = (by * z2 - y2 * bz) / determinant;
    f[2] = (y1 * bz - by * z1) / determinant;
    f[0] = b[0] - f[1] - f[2];
}

/* The same matrix, transposed: Td from qd = J^-1 Td, or Tdd from qdd - c. */
static inline void plate_from_carts(const links *k, const double b[3], double x[3])
{
    const double y1 = k->y[1] - k->y[0], y2 = k->y[2] - k->y[0], b1 = b[1] - b[0];
    const double z1 = k->z[1] - k->z[0], z2 = k->z[2] - k->z[0], b2 = b[2] - b[0];
    const double determinant = y1 * z2 - y2 * z1;
    x[1] = (b1 * z2 - b2 * z1) / determinant;
    x[2] = (y1 * b2 - y2 * b1) / determinant;
    x[0] = b[0] - k->y[0] * x[1] - k->z[0] * x[2];
}

/* Mass that every motion of the plate along x moves with it, half of each link included: (6.7). */
static inline double half_links(const three_link *robot)
{
    return (robot->m_a[0] + robot->m_a[1] + robot->m_a[2]) / 2.0;
}

void three_link_fk(const three_link *robot, const double q[3], double T[3])
{
    double p[3], b[3], c[3]; /* the first cart joint, and the others seen from it */
    for (int j = 0; j < 3; j++) {
        p[j] = robot->A[0][j];
        b[j] = robot->A[1][j] - p[j];
        c[j] = robot->A[2][j] - p[j];
    }
    p[0] += q[0];
    b[0] += q[1] - q[0];
    c[0] += q[2] - q[0];
    /* spheres subtracted: b . (T - p) = beta, c . (T - p) = gamma */
    const double bb = square(b[0]) + square(b[1]) + square(b[2]);
    const double cc = square(c[0]) + square(c[1]) + square(c[2]);
    const double bc = b[0] * c[0] + b[1] * c[1] + b[2] * c[2];
    const double L2 = square(robot->L[0]);
    const double beta = (L2 - square(robot->L[1]) + bb) / 2.0;
    const double gamma = (L2 - square(robot->L[2]) + cc) / 2.0;
    /* T - p = u b + v c + w n with n = b x c, n . n = bb cc - bc^2 */
    const double nn = bb * cc - square(bc);
    const double u = (beta * cc - gamma * bc) / nn;
    const double v = (gamma * bb - beta * bc) / nn;
    const double n[3] = {b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]};
    const double w = copysign(sqrt((L2 - u * beta - v * gamma) / nn), n[0]); /* ahead along x */
    for (int j = 0; j < 3; j++) {
        T[j] = p[j] + u * b[j] + v * c[j] + w * n[j];
    }
}

void three_link_ik(const three_link *robot, const double T[3], double q[3])
{
    for (int i = 0; i < 3; i++) {
        const double dy = T[1] - robot->A[i][1];
        const double dz = T[2] - robot->A[i][2];
        q[i] = T[0] - robot->A[i][0] - sqrt(square(robot->L[i]) - square(dy) - square(dz));
    }
}

void three_link_velocity(const three_link *robot, const double T[3], const double Td[3], double qd[3])
{
    links k;
    links_of_plate(robot, T, &k);
    cart_velocity(&k, Td, qd);
}

void three_link_inverse_dynamics(const three_link *robot, three_link_friction law, const double T[3],
                                 const double Td[3], const double Tdd[3], double tau[3])
{
    links k;
    double qd[3], qdd[3], load[3], f[3];
    links_of_plate(robot, T, &k);
    cart_velocity(&k, Td, qd);
    centripetal(&k, Td, qd, qdd);
    /* M1 Tdd + G, then M2 qdd of (6.7) */
    const double half = half_links(robot);
    load[0] = (robot->m_p + half) * Tdd[0];
    load[1] = (robot->m_p + half / 2.0) * Tdd[1];
    load[2] = (robot->m_p + half / 2.0) * Tdd[2] + (robot->m_p + half) * robot->g;
    for (int i = 0; i < 3; i++) {
        const double quarter = robot->m_a[i] / 4.0;
        qdd[i] += Tdd[0] + k.y[i] * Tdd[1] + k.z[i] * Tdd[2];
        const double across = quarter * Tdd[0] + (robot->m_c[i] + quarter) * qdd[i];
        load[0] += (robot->m_c[i] + 2.0 * quarter) * qdd[i];
        load[1] += k.y[i] * across;
        load[2] += k.z[i] * across;
    }
    forces_on_carts(&k, load, tau);
    friction(robot, law, qd, f);
    for (int i = 0; i < 3; i++) {
        tau[i] += f[i];
    }
}

/* Tdd at a known state: (M1 + M2 J^-1) Tdd = J^-T (tau - friction) - G - M2 c, the matrix symmetric. */
static inline void plate_acceleration(const three_link *robot, three_link_friction law, const links *k,
                                      const double qd[3], const double c[3], const double tau[3], double Tdd[3])
{
    double f[3];
    friction(robot, law, qd, f);
    const double half = half_links(robot);
    double m00 = robot->m_p + half, m01 = 0.0, m02 = 0.0;
    double m11 = robot->m_p + half / 2.0, m12 = 0.0, m22 = m11;
    double b0 = 0.0, b1 = 0.0, b2 = -m00 * robot->g;
    for (int i = 0; i < 3; i++) {
        const double y = k->y[i], z = k->z[i];
        const double along = robot->m_c[i] + robot->m_a[i] / 2.0;
        const double across = robot->m_c[i] + robot->m_a[i] / 4.0;
        const double force = tau[i] - f[i];
        const double pull = force - across * c[i];
        m00 += along;
        m01 += along * y;
        m02 += along * z;
        m11 += across * y * y;
        m12 += across * y * z;
        m22 += across * z * z;
        b0 += force - along * c[i];
        b1 += y * pull;
        b2 += z * pull;
    }
    /* L D L' */
    const double l1 = m01 / m00, l2 = m02 / m00;
    const double d1 = m11 - l1 * m01;
    const double e = m12 - l1 * m02;
    const double l3 = e / d1;
    const double d2 = m22 - l2 * m02 - l3 * e;
    const double x1 = b1 - l1 * b0;
    const double x2 = b2 - l2 * b0 - l3 * x1;
    Tdd[2] = x2 / d2;
    Tdd[1] = x1 / d1 - l3 * Tdd[2];
    Tdd[0] = b0 / m00 - l1 * Tdd[1] - l2 * Tdd[2];
}

void three_link_forward_dynamics_T(const three_link *robot, three_link_friction law, const double T[3],
                                   const double Td[3], const double tau[3], double Tdd[3])
{
    links k;
    double qd[3], c[3];
    links_of_plate(robot, T, &k);
    cart_velocity(&k, Td, qd);
    centripetal(&k, Td, qd, c);
    plate_acceleration(robot, law, &k, qd, c, tau, Tdd);
}

void three_link_forward_dynamics_q(const three_link *robot, three_link_friction law, const double q[3],
                                   const double qd[3], const double tau[3], double qdd[3])
{
    links k;
    double T[3], Td[3], Tdd[3], c[3];
    three_link_fk(robot, q, T);
    for (int i = 0; i < 3; i++) {
        k.dx[i] = T[0] - robot->A[i][0] - q[i];
        k.y[i] = (T[1] - robot->A[i][1]) / k.dx[i];
        k.z[i] = (T[2] - robot->A[i][2]) / k.dx[i];
    }
    plate_from_carts(&k, qd, Td);
    centripetal(&k, Td, qd, c);
    plate_acceleration(robot, law, &k, qd, c, tau, Tdd);
    for (int i = 0; i < 3; i++) {
        qdd[i] = Tdd[0] + k.y[i] * Tdd[1] + k.z[i] * Tdd[2] + c[i];
    }
}
