/* The yardstick: one drive, written by hand as a drive engineer would, to measure cogless's engine against.
 *
 * The same equations as cogless: PMSM in dq with saliency, flux harmonics and cogging, friction, RK4 once per
 * current-loop tick in double; averaged inverter with dead time, one sample of delay; encoder and current
 * sensors; FOC, speed PI and angle-indexed ILC in float. No options, no events, no other motor or law.
 *
 * Reads "name value" pairs (SI) from standard input up to "end", runs them, and prints one JSON line:
 * CPU time per tick, the last angle, and the standard deviation of what ripples, so that run.py can check that both did
 * the same job.
 */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define TWO_PI 6.283185307179586
#define INV_SQRT3 0.5773502691896258
enum { N_FLUX = 2, N_COGGING = 3, MAX_POWERS = 32, CELLS_MAX = 1024 };
enum { THETA_M = 1, OMEGA_M = 2, I_Q = 6, TAU_E = 14, TAU_COGGING = 15, COLUMNS = 21 }; /* of the trace */

/* ---- parameters, read at run time ---- */

typedef struct {
    double pole_pairs, R_s, L_d, L_q, psi_f;
    double flux_order[N_FLUX], flux_d[N_FLUX], flux_q[N_FLUX]; /* electrical order, Wb */
    double cogging_order[N_COGGING], cogging_torque[N_COGGING], cogging_phase[N_COGGING]; /* mechanical */
    double inertia, viscous_friction, coulomb_friction, load;
    double bus_voltage, dead_time, counts, adc_range, adc_bits;
    double offset[3], gain_error[3];
    double tick_rate, speed_divider;
    double kp_d, ki_d, kp_q, ki_q, current_limit;
    double speed_reference, initial_speed, kp, ki, ilc_gain, ilc_forgetting, ilc_limit, ilc_cells;
    double ticks;
} Parameters;

static const struct { const char *name; size_t offset; } fields[] = {
#define FIELD(name) { #name, offsetof(Parameters, name) }
    FIELD(pole_pairs), FIELD(R_s), FIELD(L_d), FIELD(L_q), FIELD(psi_f),
    FIELD(flux_order[0]), FIELD(flux_order[1]), FIELD(flux_d[0]), FIELD(flux_d[1]), FIELD(flux_q[0]), FIELD(flux_q[1]),
    FIELD(cogging_order[0]), FIELD(cogging_order[1]), FIELD(cogging_order[2]),
    FIELD(cogging_torque[0]), FIELD(cogging_torque[1]), FIELD(cogging_torque[2]),
    FIELD(cogging_phase[0]), FIELD(cogging_phase[1]), FIELD(cogging_phase[2]),
    FIELD(inertia), FIELD(viscous_friction), FIELD(coulomb_friction), FIELD(load),
    FIELD(bus_voltage), FIELD(dead_time), FIELD(counts), FIELD(adc_range), FIELD(adc_bits),
    FIELD(offset[0]), FIELD(offset[1]), FIELD(offset[2]),
    FIELD(gain_error[0]), FIELD(gain_error[1]), FIELD(gain_error[2]),
    FIELD(tick_rate), FIELD(speed_divider),
    FIELD(kp_d), FIELD(ki_d), FIELD(kp_q), FIELD(ki_q), FIELD(current_limit),
    FIELD(speed_reference), FIELD(initial_speed), FIELD(kp), FIELD(ki),
    FIELD(ilc_gain), FIELD(ilc_forgetting), FIELD(ilc_limit), FIELD(ilc_cells), FIELD(ticks),
};

static void read_parameters(Parameters *p)
{
    char name[64];
    while (scanf("%63s", name) == 1 && strcmp(name, "end") != 0) {
        size_t k = 0, n = sizeof fields / sizeof *fields;
        double value;
        while (k < n && strcmp(fields[k].name, name) != 0) ++k;
        if (k == n || scanf("%lf", &value) != 1) {
            fprintf(stderr, "yardstick: bad parameter %s\n", name);
            exit(2);
        }
        memcpy((char *)p + fields[k].offset, &value, sizeof value);
    }
}

/* ---- the plant, in double ---- */

/* exp(j n theta_m) for all orders n, from one sine and cosine at their common divisor: power k is a product of two
 * earlier ones. */
typedef struct {
    int base, count, multiple[MAX_POWERS], a[MAX_POWERS], b[MAX_POWERS];
} Powers;

typedef struct { double c[MAX_POWERS], s[MAX_POWERS]; } Angle;

static int power(Powers *w, int multiple)
{
    int a = -1, b = -1;
    for (int k = 0; k < w->count; ++k) {
        if (w->multiple[k] == multiple) return k;
        for (int j = 0; j <= k; ++j) {
            if (w->multiple[j] + w->multiple[k] == multiple) a = j, b = k;
        }
    }
    if (a < 0) {
        a = power(w, multiple / 2);
        b = power(w, multiple - multiple / 2);
    }
    w->multiple[w->count] = multiple;
    w->a[w->count] = a;
    w->b[w->count] = b;
    return w->count++;
}

static int divisor(int a, int b)
{
    return b == 0 ? a : divisor(b, a % b);
}

static inline void set_angle(const Powers *w, double theta, Angle *e)
{
    double c = cos(w->base * theta), s = sin(w->base * theta);
    e->c[0] = c;
    e->s[0] = s;
    for (int k = 1; k < w->count; ++k) { /* mostly a chain: the last power stays in registers */
        double ca = c, sa = s, cb = c, sb = s;
        if (w->a[k] != k - 1) ca = e->c[w->a[k]], sa = e->s[w->a[k]];
        if (w->b[k] != k - 1) cb = e->c[w->b[k]], sb = e->s[w->b[k]];
        e->c[k] = c = ca * cb - sa * sb;
        e->s[k] = s = sa * cb + ca * sb;
    }
}

typedef struct { double i_d, i_q, omega, theta; } State;

typedef struct {
    Powers powers;
    int electrical, flux[N_FLUX], cogging[N_COGGING]; /* which power */
    double in_d[N_FLUX], in_q[N_FLUX];                     /* V s, of sine and cosine */
    double cogging_sin[N_COGGING], cogging_cos[N_COGGING]; /* N m */
    double pole_pairs, R_s, L_d, L_q, inv_L_d, inv_L_q, psi_f, torque_factor;
    double inv_inertia, viscous, coulomb, load;
    double u_alpha, u_beta;      /* constant over a tick */
    double torque, cogging_torque; /* of the last derivative */
    double start_torque, start_cogging_torque; /* of the tick's first, for the record */
} Plant;

static Plant make_plant(const Parameters *p)
{
    int base = (int)p->pole_pairs;
    for (int k = 0; k < N_COGGING; ++k) base = divisor(base, (int)p->cogging_order[k]);
    Plant m = {.powers = {.base = base, .count = 1, .multiple = {1}}};
    m.electrical = power(&m.powers, (int)p->pole_pairs / base);
    for (int k = 0; k < N_FLUX; ++k) {
        m.flux[k] = power(&m.powers, (int)(p->pole_pairs * p->flux_order[k]) / base);
        /* psi_d += d cos(n theta_e), psi_q += q sin(n theta_e); of each, the slope and the other axis's value */
        m.in_d[k] = -p->flux_order[k] * p->flux_d[k] - p->flux_q[k];
        m.in_q[k] = p->flux_order[k] * p->flux_q[k] + p->flux_d[k];
    }
    for (int k = 0; k < N_COGGING; ++k) {
        m.cogging[k] = power(&m.powers, (int)p->cogging_order[k] / base);
        m.cogging_sin[k] = p->cogging_torque[k] * cos(p->cogging_phase[k]);
        m.cogging_cos[k] = p->cogging_torque[k] * sin(p->cogging_phase[k]);
    }
    m.pole_pairs = p->pole_pairs;
    m.R_s = p->R_s;
    m.L_d = p->L_d;
    m.L_q = p->L_q;
    m.inv_L_d = 1 / p->L_d;
    m.inv_L_q = 1 / p->L_q;
    m.psi_f = p->psi_f;
    m.torque_factor = 1.5 * p->pole_pairs;
    m.inv_inertia = 1 / p->inertia;
    m.viscous = p->viscous_friction;
    m.coulomb = p->coulomb_friction;
    m.load = p->load;
    return m;
}

static inline State derivative(Plant *m, const State *x, const Angle *e)
{
    /* speed voltages per electrical speed, which are the torque's linkages too */
    double e_d = -m->L_q * x->i_q, e_q = m->psi_f + m->L_d * x->i_d;
    for (int k = 0; k < N_FLUX; ++k) {
        e_d += m->in_d[k] * e->s[m->flux[k]];
        e_q += m->in_q[k] * e->c[m->flux[k]];
    }
    double cogging = 0;
    for (int k = 0; k < N_COGGING; ++k) {
        cogging += m->cogging_sin[k] * e->s[m->cogging[k]] + m->cogging_cos[k] * e->c[m->cogging[k]];
    }
    const double ce = e->c[m->electrical], se = e->s[m->electrical];
    const double u_d = ce * m->u_alpha + se * m->u_beta, u_q = ce * m->u_beta - se * m->u_alpha;
    const double omega_e = m->pole_pairs * x->omega;
    const double torque = m->torque_factor * (e_d * x->i_d + e_q * x->i_q);

    double net = torque + cogging - m->viscous * x->omega - m->load;
    if (x->omega > 0) {
        net -= m->coulomb;
    } else if (x->omega < 0) {
        net += m->coulomb;
    } else {
        net = net > m->coulomb ? net - m->coulomb : net < -m->coulomb ? net + m->coulomb : 0;
    }
    m->torque = torque;
    m->cogging_torque = cogging;
    return (State){
        .i_d = (u_d - m->R_s * x->i_d - omega_e * e_d) * m->inv_L_d,
        .i_q = (u_q - m->R_s * x->i_q - omega_e * e_q) * m->inv_L_q,
        .omega = net * m->inv_inertia,
        .theta = x->omega,
    };
}

static inline State moved(const State *x, const State *slope, double h)
{
    return (State){x->i_d + h * slope->i_d, x->i_q + h * slope->i_q, x->omega + h * slope->omega,
                   x->theta + h * slope->theta};
}

/* One RK4 step from x, where the angle is e; friction stops the rotor where the speed changes sign. */
static State step_plant(Plant *m, const State *x, const Angle *e, double h)
{
    State y;
    Angle f;
    const State k1 = derivative(m, x, e);
    m->start_torque = m->torque;
    m->start_cogging_torque = m->cogging_torque;
    y = moved(x, &k1, 0.5 * h);
    set_angle(&m->powers, y.theta, &f);
    const State k2 = derivative(m, &y, &f);
    y = moved(x, &k2, 0.5 * h);
    set_angle(&m->powers, y.theta, &f);
    const State k3 = derivative(m, &y, &f);
    y = moved(x, &k3, h);
    set_angle(&m->powers, y.theta, &f);
    const State k4 = derivative(m, &y, &f);
    State next = {
        x->i_d + h / 6 * (k1.i_d + 2 * (k2.i_d + k3.i_d) + k4.i_d),
        x->i_q + h / 6 * (k1.i_q + 2 * (k2.i_q + k3.i_q) + k4.i_q),
        x->omega + h / 6 * (k1.omega + 2 * (k2.omega + k3.omega) + k4.omega),
        x->theta + h / 6 * (k1.theta + 2 * (k2.theta + k3.theta) + k4.theta),
    };
    if (next.omega * x->omega < 0) next.omega = 0;
    return next;
}

/* ---- the controller, in float ---- */

static inline void sincosf_fast(float theta, float *sine, float *cosine)
{
    const float turns = theta * 0.636619772f + 0.5f;
    int quadrant = (int)turns;
    if ((float)quadrant > turns) --quadrant;
    const float n = (float)quadrant;
    const float r = ((theta - n * 1.5703125f) - n * 4.8375129699707031e-4f) - n * 7.5497899548918821e-8f;
    const float r2 = r * r;
    const float s = r * (1 + r2 * (-1.0f / 6 + r2 * (1.0f / 120 + r2 * (-1.0f / 5040 + r2 / 362880))));
    const float c = 1 + r2 * (-0.5f + r2 * (1.0f / 24 + r2 * (-1.0f / 720 + r2 / 40320)));
    const float a = quadrant & 1 ? c : s, b = quadrant & 1 ? s : c;
    *sine = quadrant & 2 ? -a : a;
    *cosine = (quadrant + 1) & 2 ? -b : b;
}

static inline float clampf(float x, float limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

typedef struct {
    float kp_d, ki_d, kp_q, ki_q, inv_kp_d, inv_kp_q, L_d, L_q, psi_f, u_dc, inv_u_dc, u_max, u_max_squared, advance;
    float integral_d, integral_q;
    float u_d, u_q;
} CurrentLoop;

/* dq PI with decoupling and back calculation, then space-vector modulation: duty cycles. */
static void step_current_loop(CurrentLoop *f, const float i[3], float theta_e, float omega_e, float i_q_ref,
                              float duty[3])
{
    float sine, cosine;
    sincosf_fast(theta_e, &sine, &cosine);
    const float i_alpha = (2 * i[0] - i[1] - i[2]) * (1.0f / 3), i_beta = (i[1] - i[2]) * (float)INV_SQRT3;
    const float i_d = cosine * i_alpha + sine * i_beta, i_q = cosine * i_beta - sine * i_alpha;
    const float e_d = -i_d, e_q = i_q_ref - i_q;
    float u_d = f->kp_d * e_d + f->integral_d - omega_e * f->L_q * i_q;
    float u_q = f->kp_q * e_q + f->integral_q + omega_e * (f->L_d * i_d + f->psi_f);
    float back_d = 0, back_q = 0;
    const float squared = u_d * u_d + u_q * u_q;
    if (squared > f->u_max_squared) {
        const float factor = f->u_max / sqrtf(squared);
        back_d = (factor - 1) * u_d * f->inv_kp_d;
        back_q = (factor - 1) * u_q * f->inv_kp_q;
        u_d *= factor;
        u_q *= factor;
    }
    f->integral_d = clampf(f->integral_d + f->ki_d * (e_d + back_d), f->u_max);
    f->integral_q = clampf(f->integral_q + f->ki_q * (e_q + back_q), f->u_max);

    sincosf_fast(theta_e + f->advance * omega_e, &sine, &cosine);
    const float alpha = cosine * u_d - sine * u_q, beta = sine * u_d + cosine * u_q;
    const float half = -0.5f * alpha, side = 0.866025404f * beta;
    const float a = alpha, b = half + side, c = half - side;
    const float high = a > b ? (a > c ? a : c) : (b > c ? b : c), low = a < b ? (a < c ? a : c) : (b < c ? b : c);
    const float centre = 0.5f * (high + low);
    duty[0] = 0.5f + clampf((a - centre) * f->inv_u_dc, 0.5f);
    duty[1] = 0.5f + clampf((b - centre) * f->inv_u_dc, 0.5f);
    duty[2] = 0.5f + clampf((c - centre) * f->inv_u_dc, 0.5f);
    f->u_d = u_d;
    f->u_q = u_q;
}

typedef struct {
    float kp, ki, limit, gain, forgetting, ilc_limit, cells;
    float integral, proportional, learned;
    int saturated, started;
    float position, value;  /* where the last learned value belongs [cells], and the value */
    int passed;             /* the cell written last; -1: none */
    float before;           /* what it held a revolution ago, for as long as the rotor is next to it [A] */
    float map[CELLS_MAX];   /* over one mechanical revolution [A] */
} SpeedLoop;

/* Speed PI, and beside it learning over the angle: u = forgetting u(one revolution ago) + gain e. */
static float step_speed_loop(SpeedLoop *g, float error, float theta_m)
{
    const int cells = (int)g->cells;
    const float turns = theta_m * (float)(1 / TWO_PI);
    int whole = (int)turns;
    if ((float)whole > turns) --whole;
    const float x = (turns - (float)whole) * g->cells;
    const int n = (int)x, after = n + 1 < cells ? n + 1 : 0;
    const float here = n == g->passed ? g->before : g->map[n], there = after == g->passed ? g->before : g->map[after];
    const float recalled = here + (x - (float)n) * (there - here);
    if (g->saturated) {
        g->learned = recalled;
        g->started = 0;
        g->passed = -1;
    } else {
        g->learned = clampf(g->forgetting * recalled + g->gain * error, g->ilc_limit);
        float distance = x - g->position;
        distance += distance > 0.5f * g->cells ? -g->cells : distance < -0.5f * g->cells ? g->cells : 0;
        if (g->started && fabsf(distance) <= 0.25f * g->cells && distance != 0) {
            const float slope = (g->learned - g->value) / distance, to = g->position + distance;
            const int step = distance > 0 ? 1 : -1;
            int k = (int)g->position;
            if (step > 0 || (float)k == g->position) k += step;
            for (; step > 0 ? (float)k <= to : (float)k >= to; k += step) {
                g->passed = k < 0 ? k + cells : k >= cells ? k - cells : k;
                g->before = g->map[g->passed];
                g->map[g->passed] = g->value + slope * ((float)k - g->position);
            }
        }
        g->position = x;
        g->value = g->learned;
        g->started = 1;
    }
    const float integral = clampf(g->integral + g->ki * error, g->limit);
    g->proportional = g->kp * error;
    const float wanted = g->proportional + integral + g->learned, output = clampf(wanted, g->limit);
    g->saturated = wanted != output;
    if (!g->saturated || error * output < 0) {
        g->integral = integral;
        return output;
    }
    return clampf(g->proportional + g->integral + g->learned, g->limit);
}

/* ---- the drive ---- */

typedef struct {
    CurrentLoop current_loop;
    SpeedLoop speed_loop;
    State x;
    float duty[3];       /* computed in the last tick, acting in this one */
    float i_q_ref, omega_measured;
    long counts_before;
} Drive;

static void init_drive(const Parameters *p, Drive *v)
{
    const double ts = 1 / p->tick_rate;
    memset(v, 0, sizeof *v);
    v->current_loop = (CurrentLoop){
        .kp_d = (float)p->kp_d, .ki_d = (float)(p->ki_d * ts), .kp_q = (float)p->kp_q, .ki_q = (float)(p->ki_q * ts),
        .inv_kp_d = (float)(1 / p->kp_d), .inv_kp_q = (float)(1 / p->kp_q),
        .L_d = (float)p->L_d, .L_q = (float)p->L_q, .psi_f = (float)p->psi_f,
        .u_dc = (float)p->bus_voltage, .inv_u_dc = (float)(1 / p->bus_voltage),
        .u_max = (float)(p->bus_voltage * INV_SQRT3),
        .u_max_squared = (float)(p->bus_voltage * p->bus_voltage / 3), .advance = (float)(1.5 * ts),
    };
    v->speed_loop.kp = (float)p->kp;
    v->speed_loop.ki = (float)(p->ki * p->speed_divider * ts);
    v->speed_loop.limit = (float)p->current_limit;
    v->speed_loop.gain = (float)p->ilc_gain;
    v->speed_loop.forgetting = (float)p->ilc_forgetting;
    v->speed_loop.ilc_limit = (float)p->ilc_limit;
    v->speed_loop.cells = (float)p->ilc_cells;
    v->speed_loop.passed = -1;
    v->x.omega = p->initial_speed;
    /* as if it had turned at this speed before */
    v->counts_before = (long)floor(-p->initial_speed * p->speed_divider * ts * p->counts / TWO_PI);
    v->duty[0] = v->duty[1] = v->duty[2] = 0.5f;
}

/* Runs the drive and writes a row of the trace at every speed-loop sample. */
static void run(const Parameters *p, Plant *m, Drive *v, double *rows)
{
    const double h = 1 / p->tick_rate;
    const long ticks = (long)p->ticks, divider = (long)p->speed_divider;
    const double counts_per_rad = p->counts / TWO_PI, rad_per_count = TWO_PI / p->counts;
    const double speed_per_count = rad_per_count * p->tick_rate / p->speed_divider;
    const double lsb = 2 * p->adc_range / ldexp(1, (int)p->adc_bits), inv_lsb = 1 / lsb;
    const double code_max = ldexp(1, (int)p->adc_bits - 1) - 1;
    const double dead_part = p->dead_time * p->tick_rate;
    const double gain[3] = {1 + p->gain_error[0], 1 + p->gain_error[1], 1 + p->gain_error[2]};

    for (long tick = 0; tick < ticks; ++tick) {
        /* sensors */
        Angle e;
        set_angle(&m->powers, v->x.theta, &e);
        const double ce = e.c[m->electrical], se = e.s[m->electrical];
        const double alpha = ce * v->x.i_d - se * v->x.i_q, beta = se * v->x.i_d + ce * v->x.i_q;
        const double side = 0.8660254037844386 * beta;
        const double i[3] = {alpha, -0.5 * alpha + side, -0.5 * alpha - side};
        float measured[3];
        for (int k = 0; k < 3; ++k) {
            const double code = floor((gain[k] * i[k] + p->offset[k]) * inv_lsb + 0.5);
            measured[k] = (float)(lsb * (code > code_max ? code_max : code < -code_max - 1 ? -code_max - 1 : code));
        }
        const long count = (long)floor(v->x.theta * counts_per_rad);
        const float theta_m = (float)((double)(count % (long)p->counts) * rad_per_count);

        /* controllers */
        const int speed_sample = tick % divider == 0;
        if (speed_sample) {
            v->omega_measured = (float)((double)(count - v->counts_before) * speed_per_count);
            v->counts_before = count;
            v->i_q_ref = step_speed_loop(&v->speed_loop, (float)p->speed_reference - v->omega_measured, theta_m);
        }
        float next_duty[3];
        step_current_loop(&v->current_loop, measured, (float)p->pole_pairs * theta_m,
                          (float)p->pole_pairs * v->omega_measured, v->i_q_ref, next_duty);

        /* inverter: last tick's duty cycles, less the dead time's voltage against each current */
        double u[3];
        for (int k = 0; k < 3; ++k) {
            const double lost = v->duty[k] > 0 && v->duty[k] < 1 ? (i[k] >= 0 ? dead_part : -dead_part) : 0;
            const double share = v->duty[k] - lost;
            u[k] = p->bus_voltage * (share < 0 ? 0 : share > 1 ? 1 : share);
            v->duty[k] = next_duty[k];
        }
        m->u_alpha = (2 * u[0] - u[1] - u[2]) / 3;
        m->u_beta = (u[1] - u[2]) * INV_SQRT3;

        const State before = v->x;
        v->x = step_plant(m, &before, &e, h);
        if (speed_sample) {
            const CurrentLoop *f = &v->current_loop;
            const SpeedLoop *g = &v->speed_loop;
            const double row[COLUMNS] = {
                (double)tick * h, before.theta, before.omega, p->speed_reference, v->omega_measured, before.i_d,
                before.i_q, 0, v->i_q_ref, i[0], i[1], i[2], f->u_d, f->u_q, m->start_torque, m->start_cogging_torque,
                m->load, g->saturated, g->proportional, g->integral, g->learned,
            };
            memcpy(rows, row, sizeof row);
            rows += COLUMNS;
        }
    }
}

/* Standard deviation of a column in the second half of the trace. */
static double deviation(const double *trace, size_t rows, size_t column)
{
    double sum = 0, squares = 0;
    for (size_t n = rows / 2; n < rows; ++n) sum += trace[n * COLUMNS + column];
    const double mean = sum / (double)(rows - rows / 2);
    for (size_t n = rows / 2; n < rows; ++n) {
        const double from_mean = trace[n * COLUMNS + column] - mean;
        squares += from_mean * from_mean;
    }
    return sqrt(squares / (double)(rows - rows / 2));
}

int main(void)
{
    static Parameters p;
    static Drive drive;
    read_parameters(&p);
    const size_t rows = (size_t)(p.ticks / p.speed_divider) + 1;
    double *trace = calloc(rows * COLUMNS, sizeof *trace);
    if (!trace || p.ilc_cells > CELLS_MAX) return 2;
    Plant plant = make_plant(&p);
    init_drive(&p, &drive);
    const clock_t start = clock();
    run(&p, &plant, &drive, trace);
    const double ns = (double)(clock() - start) / CLOCKS_PER_SEC / p.ticks * 1e9;
    const size_t written = (size_t)((p.ticks - 1) / p.speed_divider) + 1;
    printf("{\"ns_per_tick\": %.2f, \"theta_m\": %.17g, \"omega_m\": %.17g, \"i_q\": %.17g, \"tau_e\": %.17g, "
           "\"tau_cogging\": %.17g}\n", ns, trace[(written - 1) * COLUMNS + THETA_M],
           deviation(trace, written, OMEGA_M), deviation(trace, written, I_Q), deviation(trace, written, TAU_E),
           deviation(trace, written, TAU_COGGING));
    free(trace);
    return 0;
}
