#include "encoder.h"

/* Returns (2^64 - 1) / counts, rounded down. It is computed bit by bit, because a 32-bit processor has no division of that width. */
CGL_SELDOM static uint64_t turns_per_count(uint32_t counts)
{
    uint32_t rest = UINT32_MAX % counts, low = 0U;
    for (uint32_t digit = 0U; digit < 32U; ++digit) {
        const bool carries = rest >= 0x80000000U;
        rest = 2U * rest + 1U;
        low *= 2U;
        if (carries || rest >= counts) {
            rest -= counts;
            ++low;
        }
    }
    return ((uint64_t)(UINT32_MAX / counts) << 32U) + low;
}

CGL_SELDOM cgl_error cgl_encoder_init(cgl_encoder *encoder, const cgl_encoder_config *config, uint32_t reading)
{
    if (!(config->counts >= 2U && config->zero < config->counts && (config->range == 0U || config->range >= 4U)
          && (!config->absolute || config->range == config->counts))) {
        return CGL_ERROR_CONFIG;
    }
    encoder->config = *config;
    encoder->per_count = turns_per_count(config->counts);
    cgl_encoder_reset(encoder, reading);
    return CGL_OK;
}

/* Whether the register can show this value. */
static bool is_reading(const cgl_encoder *encoder, uint32_t reading)
{
    return encoder->config.range == 0U || reading < encoder->config.range;
}

/* Returns (position + by) modulo counts; both are below counts. */
static uint32_t on(const cgl_encoder *encoder, uint32_t position, uint32_t by)
{
    const uint32_t left = encoder->config.counts - position;
    return by < left ? position + by : by - left;
}

static void put(cgl_encoder *encoder, uint32_t position)
{
    encoder->position = position;
    encoder->turns = (uint32_t)((position * encoder->per_count) >> 32U);
}

/* Returns the counts from one reading to another, the shorter way round. `forward` says whether the angle grows on this way. */
static uint32_t moved(const cgl_encoder *encoder, uint32_t from, uint32_t to, bool *forward)
{
    const uint32_t range = encoder->config.range; /* 0 stands for 2^32: unsigned subtraction wraps there */
    const uint32_t up = to >= from ? to - from : to - from + range, down = from >= to ? from - to : from - to + range;
    *forward = (up <= down) != encoder->config.backward;
    return up <= down ? up : down;
}

/* Moves the position by a number of counts. */
static void move(cgl_encoder *encoder, uint32_t by, bool forward)
{
    const uint32_t counts = encoder->config.counts, part = by < counts ? by : by % counts;
    put(encoder, on(encoder, encoder->position, forward || part == 0U ? part : counts - part));
}

/* Sets the position from the word of an absolute encoder. */
static void put_word(cgl_encoder *encoder, uint32_t word)
{
    const uint32_t counts = encoder->config.counts, zero = encoder->config.zero;
    const uint32_t ahead = word >= zero ? word - zero : word - zero + counts;
    put(encoder, encoder->config.backward && ahead > 0U ? counts - ahead : ahead);
}

CGL_SELDOM void cgl_encoder_reset(cgl_encoder *encoder, uint32_t reading)
{
    encoder->reading = is_reading(encoder, reading) ? reading : 0U;
    encoder->count = 0U;
    encoder->placed = encoder->config.absolute;
    put(encoder, 0U);
    if (encoder->config.absolute) {
        put_word(encoder, encoder->reading);
    }
}

void cgl_encoder_step(cgl_encoder *encoder, uint32_t reading)
{
    if (!is_reading(encoder, reading)) {
        return;
    }
    bool forward;
    const uint32_t by = moved(encoder, encoder->reading, reading, &forward);
    encoder->reading = reading;
    encoder->count += forward ? by : 0U - by;
    if (encoder->config.absolute) {
        put_word(encoder, reading);
    } else {
        move(encoder, by, forward);
    }
}

void cgl_encoder_index(cgl_encoder *encoder, uint32_t reading)
{
    if (encoder->config.absolute || !is_reading(encoder, reading)) {
        return;
    }
    bool forward;
    const uint32_t since = moved(encoder, reading, encoder->reading, &forward);
    encoder->position = encoder->config.zero;
    move(encoder, since, forward);
    encoder->placed = true;
}

void cgl_encoder_place(cgl_encoder *encoder, uint32_t position)
{
    if (position < encoder->config.counts) {
        put(encoder, position);
        encoder->placed = true;
    }
}
