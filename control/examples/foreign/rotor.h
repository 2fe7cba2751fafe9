/* A rotor that cogs, behind a current loop that lags, with an encoder: the plant of the foreign loops. */
#ifndef ROTOR_H
#define ROTOR_H

#include <stdint.h>

typedef struct {
    double torque_constant; /* [N m/A] */
    double inertia;         /* [kg m^2] */
    double coulomb;         /* [N m] */
    double viscous;         /* [N m s/rad] */
    double lag;             /* time constant of the current loop [s] */
    int order;              /* cogging periods a turn; half as many again, with half the torque, come to them */
    double cogging;         /* [N m] */
    uint32_t counts;        /* of the encoder, a turn */
} rotor_config;

typedef struct {
    rotor_config config;
    double turns, omega, current; /* [turns], [rad/s], [A] */
} rotor;

/* Goes on by dt [s] with this current reference [A]. */
void rotor_step(rotor *self, double current_ref, double dt);

/* The encoder's count, which goes on beyond a turn. */
int64_t rotor_count(const rotor *self);

#endif
