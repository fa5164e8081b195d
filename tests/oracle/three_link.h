/* The three-link Gantry-Tau by hand: Dressler 2012, eqs. (6.3)-(6.8), guideways along x, v = (1, 0, 0).
 *
 * The peer of the generated code in benchmarks: closed forms, parameters as inputs, nothing of gtmodel in it.
 * The plate lies ahead of every cart and of the plane through the cart joints, as on the prototypes. Poses are
 * not checked: out of reach a root is NaN. SI units.
 */
#ifndef THREE_LINK_H
#define THREE_LINK_H

typedef struct {
    double A[3][3];        /* cart joints at q = 0, one row per arm */
    double L[3];           /* link lengths */
    double m_p;            /* plate mass */
    double m_c[3];         /* cart masses */
    double m_a[3];         /* masses of the link clusters */
    double coulomb[3];     /* Coulomb friction */
    double viscous[3];     /* viscous friction */
    double velocity_scale; /* velocity at which the smoothed sign is near its end value */
    double g;              /* gravity, along -z */
} three_link;

/* How the sign of (6.8) is smoothed. */
typedef enum { THREE_LINK_TANH, THREE_LINK_PIECEWISE_LINEAR, THREE_LINK_SIGN } three_link_friction;

/* (6.3): T from q by trilateration, and q from T. */
void three_link_fk(const three_link *robot, const double q[3], double T[3]);
void three_link_ik(const three_link *robot, const double T[3], double q[3]);

/* (6.5): cart velocities from T and its velocity. */
void three_link_velocity(const three_link *robot, const double T[3], const double Td[3], double qd[3]);

/* (6.6)-(6.8): motor forces from a motion of the plate. */
void three_link_inverse_dynamics(const three_link *robot, three_link_friction law, const double T[3],
                                 const double Td[3], const double Tdd[3], double tau[3]);

/* (6.6)-(6.8): accelerations from motor forces; the state is (T, Td) or (q, qd). */
void three_link_forward_dynamics_T(const three_link *robot, three_link_friction law, const double T[3],
                                   const double Td[3], const double tau[3], double Tdd[3]);
void three_link_forward_dynamics_q(const three_link *robot, three_link_friction law, const double q[3],
                                   const double qd[3], const double tau[3], double qdd[3]);

#endif
