#include "arms.h"

#include <math.h>

#define PI 3.14159265358979323846

static double within_pi(double angle)
{
    return angle > PI ? angle - 2.0 * PI : angle <= -PI ? angle + 2.0 * PI : angle;
}

/* K. P. Hawkins, Analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms, 2013; here in unit vectors. */
int ur5e_inverse(const double T[3], const double R[9], const double sign[3], double q[6])
{
    const double d1 = 0.1625, a2 = -0.425, a3 = -0.3922, d4 = 0.1333, d5 = 0.0997, d6 = 0.0996;
    /* joint 1: the origin of frame 5 has the distance d4 from the plane of the arm */
    const double px = T[0] - d6 * R[2], py = T[1] - d6 * R[5];
    const double r2 = px * px + py * py, square = r2 - d4 * d4;
    if (!(square >= 0.0)) {
        return 1;
    }
    const double root = sign[0] * sqrt(square), c1 = (px * root - py * d4) / r2, s1 = (py * root + px * d4) / r2;
    q[0] = atan2(s1, c1);
    /* joint 5: how far the tool is from that plane */
    const double c5 = (T[0] * s1 - T[1] * c1 - d4) / d6;
    if (!(fabs(c5) <= 1.0)) {
        return 1;
    }
    const double s5 = sign[2] * sqrt(1.0 - c5 * c5);
    q[4] = atan2(s5, c5);
    if (fabs(s5) < 1e-6) {
        return 2;
    }
    /* joint 6: the normal of the plane, seen from the tool */
    const double nx = (R[0] * s1 - R[3] * c1) / s5, ny = (R[1] * s1 - R[4] * c1) / s5;
    q[5] = atan2(-ny, nx); /* nx, ny are its cosine and minus its sine */
    /* axis 5, then joints 2 and 3 in the plane */
    const double kx = R[0] * ny - R[1] * nx, ky = R[3] * ny - R[4] * nx, kz = R[6] * ny - R[7] * nx;
    const double u = c1 * (px - d5 * kx) + s1 * (py - d5 * ky), w = T[2] - d6 * R[8] - d5 * kz - d1;
    const double c3 = (u * u + w * w - a2 * a2 - a3 * a3) / (2.0 * a2 * a3);
    if (!(fabs(c3) <= 1.0)) {
        return 1;
    }
    const double s3 = sign[1] * sqrt(1.0 - c3 * c3);
    if (fabs(s3) < 1e-6) {
        return 2;
    }
    q[2] = atan2(s3, c3);
    q[1] = atan2(w, u) - atan2(a3 * s3, a2 + a3 * c3);
    q[3] = within_pi(within_pi(atan2(c1 * kx + s1 * ky, -kz) - q[1]) - q[2]);
    q[1] = within_pi(q[1]);
    return 0;
}

int scara_inverse(const double T[3], const double R[9], double sign, double q[4])
{
    const double a1 = 0.3, a2 = 0.25, tilt = 1e-9;
    if (!(fabs(R[2]) < tilt && fabs(R[5]) < tilt && fabs(R[6]) < tilt && fabs(R[7]) < tilt && R[8] < 0.0)) {
        return 1; /* the tool axis points down */
    }
    const double c2 = (T[0] * T[0] + T[1] * T[1] - a1 * a1 - a2 * a2) / (2.0 * a1 * a2);
    if (!(fabs(c2) <= 1.0)) {
        return 1;
    }
    const double s2 = sign * sqrt(1.0 - c2 * c2);
    if (fabs(s2) < 1e-6) {
        return 2;
    }
    q[1] = atan2(s2, c2);
    q[0] = within_pi(atan2(T[1], T[0]) - atan2(a2 * s2, a1 + a2 * c2));
    q[2] = -T[2];
    q[3] = within_pi(within_pi(q[0] + q[1]) - atan2(R[3], R[0]));
    return 0;
}
