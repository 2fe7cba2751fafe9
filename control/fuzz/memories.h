/* Configs of the memories from the fuzzer's bytes. */
#ifndef MEMORIES_H
#define MEMORIES_H

#include "cogless/space_memory.h"
#include "law.h"

static inline cgl_memory_config feed_memory(feed *from)
{
    cgl_memory_config config;
    config.kind = feed_below(from, 3U) == 0U ? CGL_MEMORY_TIME : CGL_MEMORY_ANGLE;
    config.cells = 4U + feed_below(from, CELLS_MAX - 3U);
    config.periods_per_rev = 1U + (feed_bool(from) ? feed_below(from, 8U) : feed_below(from, 65535U));
    config.q_half_width = feed_bool(from) ? 0U : feed_below(from, (config.cells + 1U) / 2U);
    config.lead = feed_bool(from) ? 0U : feed_below(from, config.cells / 4U + 1U);
    config.forgetting = feed_bool(from) ? CGL_R(1.0) : feed_gain(from, CGL_R(1.0));
    config.limit = feed_gain(from, CGL_R(5.0));
    return config;
}

static inline cgl_space_memory_config feed_space_memory(feed *from)
{
    cgl_space_memory_config config;
    config.kind = feed_bool(from) ? CGL_SPACE_MAP : CGL_SPACE_DELAY;
    config.channels = 1U + feed_below(from, CGL_SPACE_CHANNELS);
    config.cells = 4U + feed_below(from, CELLS_MAX - 3U);
    config.turns = 1U + (feed_bool(from) ? 0U : feed_below(from, 65535U));
    config.parts = 1U + (feed_bool(from) ? feed_below(from, 8U) : feed_below(from, 65535U));
    config.q_half_width = feed_bool(from) ? 0U : feed_below(from, (config.cells + 1U) / 2U);
    config.method = feed_bool(from) ? CGL_DELAY_ODE : CGL_DELAY_INVERSION;
    config.k_pp = feed_gain(from, CGL_R(20.0));
    for (uint32_t c = 0; c < CGL_SPACE_CHANNELS; ++c) {
        config.limit[c] = feed_gain(from, CGL_R(5.0));
    }
    return config;
}

static inline uint32_t space_length(const cgl_space_memory_config *config)
{
    return CGL_SPACE_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width);
}

/* A map that waits for nothing stays while learning is frozen; a delay line goes on. */
static inline uint32_t space_frozen_length(const cgl_space_memory_config *config, const cgl_space_memory *memory)
{
    return config->kind == CGL_SPACE_MAP && memory->known == 0U ? config->cells : 0U;
}

/* Entries are within their limits but for rounding. */
static inline void check_space_entries(const cgl_space_memory_config *config, const cgl_real *cell)
{
    const uint32_t row = CGL_MEMORY_LENGTH(config->cells, config->q_half_width);
    const uint32_t rows = config->kind == CGL_SPACE_DELAY ? 1U : 0U;
    for (uint32_t c = 0; c < config->channels; ++c) {
        check_entries(cell + (rows + c) * row, row, config->limit[c] * CGL_R(1.00001));
    }
}

#endif
