#include "rotor.h"

#include <math.h>

#define TWO_PI 6.283185307179586

void rotor_step(rotor *self, double current_ref, double dt)
{
    const rotor_config *const c = &self->config;
    const double theta = TWO_PI * self->turns;
    self->current += (current_ref - self->current) * (1.0 - exp(-dt / c->lag));
    const double cogging = c->cogging * (sin(c->order * theta) + 0.5 * sin(1.5 * c->order * theta + 1.0));
    const double push = c->torque_constant * self->current - cogging - c->viscous * self->omega;
    const double friction = c->coulomb * tanh(self->omega / 0.02); /* smooth about standstill */
    self->omega += dt / c->inertia * (push - friction);
    self->turns += dt * self->omega / TWO_PI;
}

int64_t rotor_count(const rotor *self)
{
    return (int64_t)floor(self->turns * (double)self->config.counts);
}
