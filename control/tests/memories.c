/* Maps of any size up to the largest, over their ends and back, turns of a wrapped angle, the size of a jump, and angles up to
 * the largest with a ratio. */
#include "memories.h"

#include "check.h"
#include "cogless/angle.h"
#include "cogless/memory.h"
#include "cogless/pi_ilc.h"
#include "cogless/robust_ilc.h"

static cgl_real cell[CGL_MEMORY_LENGTH(CGL_MEMORY_ANGLE, 1U, CGL_CELLS_MAX, 2U)];

static uint32_t entries_of(const cgl_memory_config *config)
{
    return CGL_MEMORY_LENGTH(config->kind, config->channels, config->cells, config->q_half_width);
}

static cgl_memory a_map(uint32_t cells, uint32_t turns, uint32_t ratio, uint32_t q_half_width)
{
    const cgl_memory_config config = {.kind = CGL_MEMORY_ANGLE,
                                      .channels = 1U,
                                      .cells = cells,
                                      .turns = turns,
                                      .parts = 1U,
                                      .q_half_width = q_half_width,
                                      .forgetting = CGL_R(1.0e-30), /* what is stored is the correction */
                                      .limit = {CGL_R(9.0)}};
    cgl_memory memory;
    CHECK(cgl_memory_init(&memory, &config, CGL_R(1.0e-3), ratio, cell, entries_of(&config)) == CGL_OK);
    return memory;
}

/* A step at a place counted in cells of the period. */
static bool go(cgl_memory *memory, double place, cgl_real correction)
{
    const double revolutions = place / (double)memory->config.cells * (double)memory->config.turns;
    const double wrapped = revolutions - (double)(long)revolutions;
    cgl_real value;
    return cgl_memory_step(memory, (cgl_real)(wrapped * (double)CGL_TWO_PI), CGL_R(1.0), true, &correction, &value);
}

static uint32_t written(const cgl_memory *memory, cgl_real value)
{
    uint32_t n = 0U;
    for (uint32_t k = 0; k < memory->config.cells; ++k) {
        n += cell[k] >= value && cell[k] <= value ? 1U : 0U;
    }
    return n;
}

/* Every cell gets what acts there, and none other does: forward with 1, back with 2, each more than once round. */
static void sizes(void)
{
    static const uint32_t cells[] = {4U, 7U, 255U, 256U, 257U, 32767U, 32768U, 32769U, 65535U};
    for (uint32_t k = 0; k < sizeof cells / sizeof cells[0]; ++k) {
        const uint32_t width = cells[k] / 2U > 2U ? 2U : 1U;
        const double all = (double)cells[k], stride = all > 100.0 ? 7.3 : 0.6;
        cgl_memory memory = a_map(cells[k], 1U, 1U, width);
        double place = 10.0 * all + 0.5;
        for (double gone = 0.0; gone < 1.2 * all + 12.0 * stride; gone += stride) {
            go(&memory, place += stride, CGL_R(1.0));
        }
        CHECK(written(&memory, CGL_R(1.0)) == cells[k]);
        const double turned = place;
        while (place > turned - 0.5 * all) {
            go(&memory, place -= stride, CGL_R(2.0));
        }
        const uint32_t half = written(&memory, CGL_R(2.0));
        CHECK((double)half > 0.5 * all - 7.0 * stride - 2.0 && (double)half < 0.5 * all + 2.0 * stride + 2.0);
        while (place > turned - 1.2 * all - 12.0 * stride) {
            go(&memory, place -= stride, CGL_R(2.0));
        }
        CHECK(written(&memory, CGL_R(2.0)) == cells[k]);
    }
}

/* With three turns each third of the map is of another revolution. */
static void turns(void)
{
    cgl_memory memory = a_map(300U, 3U, 1U, 0U);
    for (double place = 0.25; place < 700.0; place += 0.5) {
        const uint32_t third = (uint32_t)place % 300U / 100U;
        go(&memory, place, (cgl_real)(third + 1U));
    }
    for (uint32_t n = 2; n < 300U; ++n) {
        const cgl_real off = cell[n] - (cgl_real)(n / 100U + 1U);
        CHECK(n % 100U < 2U || n % 100U > 97U || (off < CGL_R(1.0e-3) && off > CGL_R(-1.0e-3)));
    }
}

/* Of one step after rest, and one more after that, how many cells are written. */
static uint32_t after(double first, double second)
{
    cgl_memory memory = a_map(1000U, 1U, 1U, 0U);
    go(&memory, 5000.5, CGL_R(1.0));
    go(&memory, 5000.5 + first, CGL_R(1.0));
    go(&memory, 5000.5 + first + second, CGL_R(1.0));
    return written(&memory, CGL_R(1.0));
}

static void jumps(void)
{
    CHECK(after(16.0, 0.0) == 16U && after(17.0, 0.0) == 0U);
    CHECK(after(5.0, 26.0) == 31U && after(5.0, 27.0) == 5U);
    CHECK(after(17.0, 50.0) == 50U && after(17.0, 51.0) == 0U);
}

/* theta itself is compared with the largest angle, not ratio theta. */
static void ratios(void)
{
    cgl_memory memory = a_map(64U, 1U, 50U, 0U);
    for (uint32_t n = 0; n < 400U; ++n) {
        const cgl_real theta = CGL_R(1999.0) + (cgl_real)n * CGL_R(0.00625), one = CGL_R(1.0);
        cgl_real value;
        CHECK(cgl_memory_step(&memory, theta, CGL_R(1.0), true, &one, &value));
    }
    CHECK(written(&memory, CGL_R(1.0)) == 64U);
}

/* A line is no longer than a float can count. */
static void longest(void)
{
    cgl_memory memory;
    cgl_memory_config config = a_map(8U, 1U, 1U, 0U).config;
    config.kind = CGL_MEMORY_TIME;
    config.cells = CGL_SAMPLES_MAX;
    CHECK(cgl_memory_init(&memory, &config, CGL_R(1.0e-3), 1U, cell, CGL_SAMPLES_MAX) == CGL_ERROR_MEMORY);
    config.cells = CGL_SAMPLES_MAX + 1U;
    CHECK(cgl_memory_init(&memory, &config, CGL_R(1.0e-3), 1U, cell, UINT32_MAX) == CGL_ERROR_CONFIG);
    config.kind = CGL_MEMORY_ANGLE;
    config.cells = CGL_CELLS_MAX + 1U;
    CHECK(cgl_memory_init(&memory, &config, CGL_R(1.0e-3), 1U, cell, UINT32_MAX) == CGL_ERROR_CONFIG);
}

/* The lead takes a quarter of the period at most; a line's filter all of it. */
static void speeds(void)
{
    cgl_memory memory = a_map(64U, 1U, 2U, 0U);
    const cgl_real period = CGL_TWO_PI / CGL_R(2.0) / CGL_R(1.0e-3); /* in a sample [rad/s] */
    const struct {
        cgl_memory_kind kind;
        uint32_t lead, width;
        cgl_real samples;
    } cases[] = {{CGL_MEMORY_ANGLE, 0U, 0U, CGL_R(4.0)},
                 {CGL_MEMORY_ANGLE, 5U, 30U, CGL_R(20.0)},
                 {CGL_MEMORY_TIME, 5U, 30U, CGL_R(31.0)},
                 {CGL_MEMORY_TIME, 0U, 1U, CGL_R(4.0)}};
    for (uint32_t n = 0; n < sizeof cases / sizeof cases[0]; ++n) {
        cgl_memory_config config = memory.config;
        config.kind = cases[n].kind;
        config.lead = cases[n].lead;
        config.q_half_width = cases[n].width;
        CHECK(cgl_memory_init(&memory, &config, CGL_R(1.0e-3), 2U, cell, entries_of(&config)) == CGL_OK);
        const cgl_real off = cgl_memory_fastest(&memory) * cases[n].samples / period - CGL_R(1.0);
        CHECK(off < CGL_R(1.0e-5) && off > CGL_R(-1.0e-5));
    }
}

/* PI-ILC learns one channel, with a gain that is not negative; each mistake alone is refused. */
static void laws(void)
{
    cgl_pi_ilc law;
    cgl_pi_ilc_config config = {.pi = {CGL_R(1.0), CGL_R(1.0), CGL_R(9.0)}, .gain = CGL_R(1.0), .memory = a_map(8U, 1U, 1U, 0U).config};
    const uint32_t length = entries_of(&config.memory);
    const cgl_loop loop = {.ts = CGL_R(1.0e-3), .current_limit = CGL_R(9.0)};
    CHECK(cgl_pi_ilc_init(&law, &config, &loop, cell, length) == CGL_OK);
    config.gain = CGL_R(-1.0);
    CHECK(cgl_pi_ilc_init(&law, &config, &loop, cell, length) == CGL_ERROR_CONFIG);
    config.gain = CGL_R(1.0);
    config.memory.channels = 2U;
    config.memory.limit[1] = CGL_R(9.0);
    CHECK(cgl_pi_ilc_init(&law, &config, &loop, cell, length) == CGL_ERROR_CONFIG);
}

/* What fixes the meaning of what is learned must stay. */
static void keep_sizes(void)
{
    static cgl_real kept[64];
    const cgl_memory_config config = {.kind = CGL_MEMORY_ANGLE, .channels = 2U, .cells = 8U, .turns = 2U, .parts = 3U, .q_half_width = 1U,
                                      .forgetting = CGL_R(1.0), .limit = {CGL_R(1.0), CGL_R(1.0), CGL_R(1.0)}};
    cgl_memory memory;
    CHECK(cgl_memory_init(&memory, &config, CGL_R(1.0e-3), 1U, kept, entries_of(&config)) == CGL_OK);
    cgl_memory_config other[7] = {config, config, config, config, config, config, config};
    other[0].kind = CGL_MEMORY_TIME;
    other[1].channels = 1U;
    other[2].cells = 9U;
    other[3].turns = 1U;
    other[4].parts = 2U;
    other[5].q_half_width = 2U;
    other[6].lead = 2U;
    for (int n = 0; n < 7; ++n) {
        CHECK(cgl_memory_retune(&memory, &other[n]) == (n < 6 ? CGL_ERROR_CONFIG : CGL_OK));
        CHECK(memory.config.lead == (n < 6 ? 0U : 2U));
    }
}

/* P_t is the time in which the angle went on by a period. */
static void periods_ago(void)
{
    const cgl_real ts = CGL_R(1.0e-3), omega = CGL_R(40.0);
    for (int method = 0; method < 2; ++method) {
        cgl_memory memory;
        const cgl_memory_config config = {.kind = CGL_MEMORY_DELAY, .cells = 300U, .limit = {CGL_R(9.0)},
                                          .method = method > 0 ? CGL_DELAY_INVERSION : CGL_DELAY_ODE};
        const cgl_real nothing = CGL_R(0.0);
        cgl_real value;
        CHECK(cgl_memory_init(&memory, &config, ts, 1U, cell, entries_of(&config)) == CGL_OK);
        for (int n = 0; n < 2000; ++n) {
            const cgl_real theta = cgl_fraction((cgl_real)n * ts * omega / CGL_TWO_PI) * CGL_TWO_PI;
            (void)cgl_memory_step(&memory, theta, omega, true, &nothing, &value);
            CHECK(n < 200 || (memory.line.p_t - CGL_TWO_PI / omega < CGL_R(1.0e-5) && memory.line.p_t - CGL_TWO_PI / omega > CGL_R(-1.0e-5)));
        }
    }
}

/* With another lead the last correction went to a place that this lead never names: the line begins anew. */
static void another_lead(void)
{
    cgl_memory memory = a_map(64U, 1U, 1U, 0U);
    cgl_memory_config config = memory.config;
    config.forgetting = CGL_R(1.0);
    config.lead = 12U;
    CHECK(cgl_memory_init(&memory, &config, CGL_R(1.0e-3), 1U, cell, entries_of(&config)) == CGL_OK);
    double place = 20.5;
    for (int n = 0; n < 8; ++n) {
        go(&memory, place += 0.6, CGL_R(1.0));
    }
    config.lead = 1U;
    CHECK(memory.map.lagging && cgl_memory_retune(&memory, &config) == CGL_OK);
    const uint32_t untouched = written(&memory, CGL_R(0.0));
    go(&memory, place += 0.6, CGL_R(1.0));
    CHECK(written(&memory, CGL_R(0.0)) == untouched);
    go(&memory, place += 0.6, CGL_R(1.0));
    go(&memory, place += 0.6, CGL_R(1.0));
    CHECK(written(&memory, CGL_R(0.0)) < untouched && written(&memory, CGL_R(0.0)) + 3U > untouched);
}

/* The mean of what a law has learned from an error of four turns, sixty turns after it. */
static double mean_of_map(void (*step)(void *law, const cgl_law_input *in, cgl_law_output *out), void *law)
{
    double sum = 0.0;
    for (int n = 0; n < 64 * 64; ++n) {
        const cgl_law_input in = {.omega_ref = CGL_R(98.0), .omega_m = n < 4 * 64 ? CGL_R(97.0) : CGL_R(98.0), .learn = true,
                                  .theta_m = cgl_fraction(((cgl_real)n + CGL_R(0.5)) / CGL_R(64.0)) * CGL_TWO_PI};
        cgl_law_output out;
        step(law, &in, &out);
    }
    for (int n = 0; n < 64; ++n) {
        sum += (double)cell[n] / 64.0;
    }
    return sum > 0.0 ? sum : -sum;
}

static void step_pi_ilc(void *law, const cgl_law_input *in, cgl_law_output *out)
{
    cgl_pi_ilc_step((cgl_pi_ilc *)law, in, out);
}

static void step_robust_ilc(void *law, const cgl_law_input *in, cgl_law_output *out)
{
    cgl_robust_ilc_step((cgl_robust_ilc *)law, in, out);
}

/* A mean that the law's integral removes leaves the map, whether the law has had the integral since init or since a retune. The
 * robust law goes on learning from the integral of its error, so that its map keeps a part. */
static void means_of_the_integral(void)
{
    static const cgl_loop loop = {.ts = CGL_R(1.0e-3), .current_limit = CGL_R(9.0)};
    const cgl_memory_config memory = {.cells = 64U, .limit = {CGL_R(9.0)}};
    const uint32_t length = CGL_MEMORY_LENGTH(CGL_MEMORY_ANGLE, 1U, 64U, 0U);
    for (int n = 0; n < 3; ++n) { /* without an integral, with one, and with one after a retune */
        static double alone[2];
        cgl_pi_ilc ilc;
        cgl_pi_ilc_config of_ilc = {.pi = {CGL_R(0.1), CGL_R(0.0), CGL_R(9.0)}, .gain = CGL_R(0.05), .memory = memory};
        of_ilc.pi.ki = n == 1 ? CGL_R(0.1) : CGL_R(0.0);
        CHECK(cgl_pi_ilc_init(&ilc, &of_ilc, &loop, cell, length) == CGL_OK);
        of_ilc.pi.ki = n > 0 ? CGL_R(0.1) : CGL_R(0.0);
        CHECK(n < 2 || cgl_pi_ilc_retune(&ilc, &of_ilc) == CGL_OK);
        const double by_pi = mean_of_map(step_pi_ilc, &ilc);
        cgl_robust_ilc robust;
        cgl_robust_ilc_config of_robust = {.b = CGL_R(100.0), .c = CGL_R(1.0), .eta = CGL_R(1.0), .q = CGL_R(1.0), .beta_2 = CGL_R(0.05),
                                           .limit = CGL_R(9.0), .memory = memory};
        of_robust.gamma = n == 1 ? CGL_R(0.1) : CGL_R(0.0);
        CHECK(cgl_robust_ilc_init(&robust, &of_robust, &loop, cell, length) == CGL_OK);
        of_robust.gamma = n > 0 ? CGL_R(0.1) : CGL_R(0.0);
        CHECK(n < 2 || cgl_robust_ilc_retune(&robust, &of_robust) == CGL_OK);
        const double by_robust = mean_of_map(step_robust_ilc, &robust);
        if (n == 0) {
            alone[0] = by_pi;
            alone[1] = by_robust;
        }
        CHECK(n == 0 ? by_pi > 0.1 && by_robust > 0.1 : by_pi < 0.1 * alone[0] && by_robust < 0.5 * alone[1]);
    }
}

void memories(void)
{
    means_of_the_integral();
    periods_ago();
    another_lead();
    keep_sizes();
    laws();
    speeds();
    sizes();
    turns();
    jumps();
    ratios();
    longest();
}
