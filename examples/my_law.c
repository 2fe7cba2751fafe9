/* The law of my_law.py as a shared library:
 *   cc -std=c99 -O2 -shared -fPIC -I INCLUDE my_law.c -o my_law.so -lm
 * where INCLUDE is what `python -c "import cogless; print(cogless.__path__[0] + '/include')"` prints. */
#include "cogless/plugin.h"

#include <math.h>

typedef struct {
    double kp, ki, order, rate, lead;   /* as in my_law.py */
    double integral, a, b, i_q_learned; /* [A] */
} law;

uint32_t cogless_plugin_version(void) { return COGLESS_PLUGIN_VERSION; }

size_t cogless_plugin_state_size(void) { return sizeof(law); }

int cogless_plugin_init(void *state, const double *params, size_t count, double ts)
{
    law *s = state;
    if (count != 5 || !(ts > 0.0)) {
        return 1;
    }
    s->kp = params[0];
    s->ki = params[1];
    s->order = params[2];
    s->rate = params[3];
    s->lead = params[4];
    return 0;
}

void cogless_plugin_step(void *state, const cogless_plugin_input *in, cogless_plugin_output *out)
{
    law *s = state;
    const double error = in->omega_ref - in->omega_m;
    const double angle = s->order * in->theta_m;
    s->integral += s->ki * in->ts * error;
    if (in->learn) {
        s->a += s->rate * in->ts * error * sin(angle - s->lead);
        s->b += s->rate * in->ts * error * cos(angle - s->lead);
    }
    out->i_d_ref = 0.0;
    s->i_q_learned = s->a * sin(angle) + s->b * cos(angle);
    out->i_q_ref = s->kp * error + s->integral + s->i_q_learned;
}

double cogless_plugin_i_q_learned(const void *state)
{
    const law *s = state;
    return s->i_q_learned;
}

/* What is learned, for the results folder; map->law is this law's number in stored maps. */
void cogless_plugin_learned_map(const void *state, cogless_plugin_map *map)
{
    const law *s = state;
    map->law = 130;
    map->entries = 1;
    map->order = &s->order;
    map->cosine = &s->b;
    map->sine = &s->a;
}

/* Begins with what this law or any other has learned, in the same form. */
int cogless_plugin_load_map(void *state, const cogless_plugin_map *map)
{
    law *s = state;
    s->b = map->cosine[0];
    s->a = map->sine[0];
    return 0;
}
