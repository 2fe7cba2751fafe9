/* The interface of a speed law in a user's own shared library, which the simulator loads (law = "library").
 *
 * The library exports the first four functions below, in C, by these names; the others may be missing. The state is plain memory that the caller provides,
 * copies and discards as it likes: keep no pointers in it and nothing outside it. */
#ifndef COGLESS_PLUGIN_H
#define COGLESS_PLUGIN_H

#include <stddef.h>
#include <stdint.h>

#define COGLESS_PLUGIN_VERSION 2U /* 1, which the simulator loads too, ends its input with learn */

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
} cogless_plugin_input;

typedef struct {
    double i_d_ref, i_q_ref; /* references for the current loop [A]; the caller limits them */
} cogless_plugin_output;

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

/* In trials, where they are there: before the first period of a trial, with the angle reference of each [rad], and after its
 * last. In between in->theta_ref is that reference as it is, not within a turn. */
COGLESS_PLUGIN_EXPORT void cogless_plugin_begin_trial(void *state, const double *theta_ref, size_t samples);
COGLESS_PLUGIN_EXPORT void cogless_plugin_end_trial(void *state);

#ifdef __cplusplus
}
#endif

#endif
