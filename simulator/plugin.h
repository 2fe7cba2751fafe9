/* The interface of a speed law in a user's own shared library, which the simulator loads (law = "library").
 *
 * The library exports the first four functions below, in C, by these names; the others may be missing. The state is plain
 * memory that the caller provides, copies and discards as it likes: keep no pointers in it and nothing outside it. */
#ifndef COGLESS_PLUGIN_H
#define COGLESS_PLUGIN_H

#include <stddef.h>
#include <stdint.h>

/* Loaded too: 1, whose input ends with learn, 2, whose input ends with alpha_ref, and 3, which has no learned map. */
#define COGLESS_PLUGIN_VERSION 4U

typedef struct {
    double time;      /* since the start [s] */
    double omega_ref; /* mechanical speed reference [rad/s] */
    double omega_m;   /* measured mechanical speed [rad/s] */
    double theta_m;   /* measured mechanical angle [rad] */
    double i_d, i_q;  /* measured currents in the rotor's frame [A] */
    double i_limit;   /* limit of the current reference [A] */
    double ts;        /* speed-loop period [s] */
    int learn;        /* 0: hold what is learned */
    double theta_ref; /* mechanical angle reference, the integral of omega_ref, in [0, 2 pi) [rad] */
    double alpha_ref; /* derivative of omega_ref [rad/s^2] */
    int off;          /* 1: what the law asks for has no effect in this period */
} cogless_plugin_input;

typedef struct {
    double i_d_ref, i_q_ref; /* references for the current loop [A]; the caller limits them */
} cogless_plugin_output;

/* The drive as its controller knows it: what a rule for gains needs. */
typedef struct {
    double pole_pairs, phases;       /* phases: 2 or 3 */
    double slots;                    /* of the stator; 0: not told */
    double R_s, L_d, L_q, psi_f;     /* of a phase [ohm, H, H, Wb] */
    double torque_constant;          /* [N m/A], of i_q */
    double inertia;                  /* of rotor and load [kg m^2] */
    double current_limit;            /* [A] */
    double current_bandwidth;        /* of the current loop [rad/s]; 0: ideal */
    double current_period;           /* [s] */
    double delay;                    /* from sampling to the middle of the period in which the voltage acts [s] */
} cogless_plugin_drive;

/* What is learned: a current over the rotor's angle, or amplitudes of its orders [A]. The pointers are NULL where they are not
 * used; those of a learned map may point into the state. */
typedef struct {
    uint32_t law;                /* whose map it is: 128 (already set) to 255, numbers that are yours */
    uint32_t parts;              /* current has a period of a mechanical revolution / parts; 1 is already set */
    size_t entries;              /* cells of the period, or orders; 0: there is nothing to store */
    const double *current;       /* at evenly spaced angles of the period, from 0 on */
    const double *cosine, *sine; /* or the current is the sum of cosine cos(order theta_m) + sine sin(order theta_m) */
    const double *order;         /* of a mechanical revolution, whole, 1 to 65535, each once */
} cogless_plugin_map;

#if defined(_WIN32)
#define COGLESS_PLUGIN_EXPORT __declspec(dllexport)
#else
#define COGLESS_PLUGIN_EXPORT __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Returns COGLESS_PLUGIN_VERSION. */
COGLESS_PLUGIN_EXPORT uint32_t cogless_plugin_version(void);
/* Bytes of state that the law needs; at most 1 MiB. */
COGLESS_PLUGIN_EXPORT size_t cogless_plugin_state_size(void);
/* Prepares the state (zeroed, aligned for any type) from the study's params; returns 0, or another number to refuse. */
COGLESS_PLUGIN_EXPORT int cogless_plugin_init(void *state, const double *params, size_t count, double ts);
/* One speed-loop period. */
COGLESS_PLUGIN_EXPORT void cogless_plugin_step(void *state, const cogless_plugin_input *in,
                                               cogless_plugin_output *out);

/* Those that may be missing. After init: the drive; returns 0, or another number to refuse it. */
COGLESS_PLUGIN_EXPORT int cogless_plugin_design(void *state, const cogless_plugin_drive *drive);
/* The part of the last i_q_ref that is learned [A]: it becomes the signal term_learned. */
COGLESS_PLUGIN_EXPORT double cogless_plugin_i_q_learned(const void *state);
/* Every period of the current loop, after the step where one is due. in: as then, with angle, speed and currents of now.
 * out: the references of the last period, which it may change. */
COGLESS_PLUGIN_EXPORT void cogless_plugin_current_step(void *state, const cogless_plugin_input *in,
                                                       cogless_plugin_output *out);
/* The learned map, at the end of a run, where cogless stores it, and before the first step, where a study has a start. */
COGLESS_PLUGIN_EXPORT void cogless_plugin_learned_map(const void *state, cogless_plugin_map *map);
/* Before the first step, of a study with a start: takes a map with the entries, period and orders that
 * cogless_plugin_learned_map gives; returns 0, or another number to refuse it. */
COGLESS_PLUGIN_EXPORT int cogless_plugin_load_map(void *state, const cogless_plugin_map *map);

/* In trials, where they are there: before the first period of a trial, with the angle reference of each [rad], and after its
 * last. In between in->theta_ref is that reference as it is, not within a turn. */
COGLESS_PLUGIN_EXPORT void cogless_plugin_begin_trial(void *state, const double *theta_ref, size_t samples);
COGLESS_PLUGIN_EXPORT void cogless_plugin_end_trial(void *state);

#ifdef __cplusplus
}
#endif

#endif
