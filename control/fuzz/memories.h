/* Configs of the memories from the fuzzer's bytes, and what must hold of their entries. */
#ifndef MEMORIES_H
#define MEMORIES_H

#include "cogless/memory.h"
#include "law.h"

static inline uint32_t feed_count(feed *from, uint32_t usual)
{
    return 1U + feed_below(from, feed_bool(from) ? usual : 65535U);
}

static inline cgl_memory_config feed_memory(feed *from, uint32_t channels)
{
    cgl_memory_config config;
    const uint32_t kind = feed_below(from, 4U);
    config.kind = kind == 0U ? CGL_MEMORY_TIME : (kind == 1U ? CGL_MEMORY_DELAY : CGL_MEMORY_ANGLE);
    config.channels = channels;
    config.cells = 4U + feed_below(from, CELLS_MAX - 3U);
    config.turns = feed_bool(from) ? 1U : feed_count(from, 8U);
    config.parts = feed_count(from, 8U);
    config.q_half_width = feed_bool(from) ? 0U : feed_below(from, config.cells / 2U);
    config.lead = feed_bool(from) ? 0U : feed_below(from, config.cells / 4U + 1U);
    config.forgetting = feed_bool(from) ? CGL_R(1.0) : feed_gain(from, CGL_R(1.0));
    for (uint32_t c = 0; c < (uint32_t)CGL_CHANNELS; ++c) {
        config.limit[c] = feed_gain(from, CGL_R(5.0));
    }
    config.method = feed_bool(from) ? CGL_DELAY_ODE : CGL_DELAY_INVERSION;
    config.k_pp = feed_gain(from, CGL_R(20.0));
    return config;
}

static inline uint32_t memory_length(const cgl_memory_config *config)
{
    return CGL_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width);
}

/* The map's cells, without the rings between them; a line goes on while learning is frozen. */
static inline const cgl_real *map_of(const cgl_memory *memory, uint32_t *length)
{
    static cgl_real cells[CGL_CHANNELS * CELLS_MAX];
    const cgl_memory_config *const config = &memory->config;
    *length = config->kind == CGL_MEMORY_ANGLE ? config->channels * config->cells : 0U;
    for (uint32_t n = 0; n < *length; ++n) {
        const uint32_t row = n / config->cells;
        cells[n] = memory->cell[row * CGL_MEMORY_ROW(config->cells, config->q_half_width) + n % config->cells];
    }
    return cells;
}

static inline void check_memory(const cgl_memory *memory)
{
    const cgl_memory_config *const config = &memory->config;
    const uint32_t row = CGL_MEMORY_ROW(config->cells, config->q_half_width);
    const uint32_t first = config->kind == CGL_MEMORY_DELAY ? 1U : 0U;
    for (uint32_t c = 0; c < config->channels; ++c) {
        check_entries(memory->cell + (first + c) * row, row, config->limit[c]);
        HOLDS(within(memory->channel[c].value, config->limit[c]));
    }
}

#endif
