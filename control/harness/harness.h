/* What the programs that step a law with random numbers need of it: tests/random_inputs.c, where a generator draws the numbers, and
 * fuzz/controller.c, where the fuzzer's bytes are the numbers. NAME.c has the harness of a law, harness_NAME. */
#ifndef HARNESS_H
#define HARNESS_H

#include <string.h>

#include "check.h"
#include "cogless/law.h"
#include "cogless/memory.h"
#include "cogless/pi.h"

#ifndef CELLS_MAX
#define CELLS_MAX 200U
#endif
#define SAMPLES_MAX (CELLS_MAX < 60U ? CELLS_MAX : 60U)

typedef struct {
    const char *name;
    uint32_t in_float, in_double;   /* checksums of random_inputs.c, which prints new ones where the arithmetic changes */
    void *state, *config;           /* the law, and the config that it has */
    size_t state_size, config_size;
    void (*draw)(cgl_real ts);      /* draws this config, which init may refuse */
    void (*change)(void *config);   /* draws what a retune changes, and seldom what it refuses */
    void (*spoil)(void *config);    /* draws any bits for what the length depends on; NULL: nothing else than `draw` does */
    uint32_t (*length)(void);       /* number of entries of the caller's memory; NULL: there is none */
    cgl_error (*init)(const cgl_loop *loop, cgl_real *cell, uint32_t length);
    cgl_error (*retune)(const void *config);
    void (*reset)(void);
    void (*check_reset)(void);      /* checks that what has not begun is 0 */
    void (*step)(const cgl_law_input *in, cgl_law_output *out); /* steps the law, and checks its state */
    cgl_real (*limit)(void);        /* of the output */
    uint32_t (*learned)(void);      /* number of entries that stay while the law is frozen; NULL: none, or those of `memory` */
    const cgl_memory *memory;       /* what the law learns in, if that is a cgl_memory; else NULL */
    const cgl_memory_config *memory_config;
    size_t kept, kept_end;          /* the state's bytes that a reset keeps, or that are padding */
    bool keeps_learned;             /* a reset keeps what is learned */
    void (*call)(void);             /* what else a firmware calls, drawn; NULL: nothing */
    /* only for random_inputs.c, whose generator can wait until a law learns */
    void (*input)(cgl_law_input *in, int step); /* draws inputs in which the law learns */
    int steps;                                  /* number of these; 0: the usual number */
    void (*course)(void);                       /* steps and calls in an order of their own, in place of `input`; NULL: none */
} law_harness;

/* The members that each harness has of its static `law` and `config`, and of functions that have the members' names. */
#define HARNESS_BEGIN(stem, float_sum, double_sum)                                                                     \
    .name = #stem, .in_float = (float_sum), .in_double = (double_sum), .state = &law, .config = &config,               \
    .state_size = sizeof law, .config_size = sizeof config, .draw = draw, .change = change, .init = init,              \
    .retune = retune, .reset = reset, .step = step, .check_reset = check_reset, .limit = limit
#define HARNESS_MEMORY .length = length, .memory = &law.memory, .memory_config = &config.memory

#define CGL_LAW_WITHOUT_MEMORY(name, stem, header, step) extern const law_harness harness_##stem;
#include "cogless/laws.def" /* the header of each law, too */

/* Draws a config and lends the law its memory; false where init refuses it. */
bool begin_law(const law_harness *harness);
/* A step, with what every law says checked against what it did. */
void step_law(const law_harness *harness, const cgl_law_input *in, cgl_law_output *out);
/* The law takes another config, or stays as it was. */
void retune_law(const law_harness *harness);
void reset_law(const law_harness *harness);
/* What it learned and keeps is within its limits, and a law that is reset, or initialised again, is a new one. */
void end_law(const law_harness *harness);
/* A config whose sizes are any bits, and memory of any length: init may refuse them, and does no more than that. */
void spoil_law(const law_harness *harness);

/* Memory of just this length for a law, full of NaN, until it is given back. Beyond it are fences, or the address sanitizer looks. */
cgl_real *borrow(uint32_t length);
void give_back(void);
void check_fences(void);
void check_entries(const cgl_real *entry, uint32_t length, cgl_real limit);

/* Adds the terms of a law's current, a struct of reals, to the checksum. */
void hear_terms(const void *terms, size_t size);
/* What a law says of its output, term by term: they add up to it, as it is limited. */
void check_sum(cgl_real output, cgl_real sum, cgl_real limit);

/* The fields of a state, from one to another, are 0 (false, nothing). */
void check_zeros(const void *state, size_t first, size_t end);
#define CHECK_ZEROS(name, state, first, last)                                                                          \
    check_zeros((state), offsetof(cgl_##name, first), offsetof(cgl_##name, last) + sizeof (state)->last)

/* Configs. */
cgl_real gain_of_any_sign(cgl_real usual);
cgl_pi_config random_pi(void);
uint32_t random_count(uint32_t usual); /* mostly small, from 1 up */
cgl_memory_config random_memory(uint32_t channels);
cgl_memory_config another_memory(const cgl_memory_config *now); /* mostly of the same sizes, which retune wants */
uint32_t memory_length(const cgl_memory_config *config);

/* What a memory holds, against its config. */
void check_memory(const cgl_memory *memory);
/* What a step did to the entries, against what it says: `before` are all of them, `old` is the state then. */
void check_writing(const cgl_memory *memory, const cgl_memory *old, const cgl_real *before);

/* A loop that leaves a law every config: any current, and no guard. */
const cgl_loop *any_loop(cgl_real ts);

/* Inputs without random numbers. */
cgl_law_input ordinary_input(int step);
/* Any inputs, or those of a rotor that turns so that something is learned. */
void next_input(cgl_law_input *in, int step);
/* Any inputs, or those of a rotor that follows a reference which mostly rises. */
void next_position_input(cgl_law_input *in, int step);

#endif
