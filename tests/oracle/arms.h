#ifndef ARMS_H
#define ARMS_H

/* Textbook inverse kinematics by hand, beside which generated code is measured. Position T [m] and rotation R, row by
   row, of the tool; `sign`: the branch of each root, 1 or -1. Returns 0, 1 out of reach, 2 singular; q [rad, m] is
   within half a turn. */
int ur5e_inverse(const double T[3], const double R[9], const double sign[3], double q[6]); /* shoulder, elbow, wrist */
int scara_inverse(const double T[3], const double R[9], double sign, double q[4]);         /* R-R-P-R, tool downwards */

#endif
