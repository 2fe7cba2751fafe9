/* Trials of SAMPLES samples with a Q filter of ORDER and a feedforward of TAPS coefficients, begun, stepped and ended in any
 * order. */
#include "cogless/trial.h"
#include "cogless/trial_basis.h"

#include "memories.h"

static cgl_real memory[CGL_TRIAL_LENGTH(SAMPLES, ORDER)], y_ref[SAMPLES], matrix[SAMPLES * SAMPLES];

static cgl_trial_input any_trial_input(void)
{
    cgl_trial_input in;
    fill_any(in.x, CGL_TRIAL_STATES);
    in.learn = any_bool();
    return in;
}

int main(void)
{
    cgl_trial_config config;
    cgl_trial law;
    cgl_trial_output out;
    Frama_C_make_unknown((char *)&config, sizeof config);
    config.samples = SAMPLES;
    config.q_filter.order = ORDER;
    config.feedforward.numerator = config.feedforward.denominator = TAPS;
    config.limit = config.learned_limit = ANY_LIMIT;
    config.through_integrator = any_bool();
    config.filter_signal = any_bool();
    config.unguarded = any_bool();
    config.q_filter.odd = ODD; /* which samples the reflection reads depends on it */
    config.learning_matrix = any_bool() ? matrix : 0;
    Frama_C_make_unknown((char *)y_ref, sizeof y_ref);
    Frama_C_make_unknown((char *)matrix, sizeof matrix);
    FILL(memory);
    if (cgl_trial_init(&law, &config, memory, sizeof memory / sizeof memory[0]) != CGL_OK) {
        return 0;
    }
    while (any_bool()) {
        const cgl_trial_input in = any_trial_input();
        if (any_bool()) {
            cgl_trial_begin(&law, any_bool() ? y_ref : 0);
        } else if (any_bool()) {
            (void)cgl_trial_end(&law);
        } else if (any_bool()) {
            cgl_trial_reset(&law);
        } else if (any_bool()) {
            (void)cgl_trial_carry(&law, any_bool() ? y_ref : 0);
        } else if (any_bool()) {
            const cgl_law_input of_drive = any_input();
            cgl_law_output command;
            cgl_trial_drive_step(&law, &of_drive, &command);
            PROVE_OUTPUT(command.i_q_ref);
        } else {
            cgl_trial_step(&law, &in, &out);
            PROVE_OUTPUT(out.u);
        }
        const uint32_t place = any_bits();
        if (place < SAMPLES) {
            PROVE_WITHIN_LIMIT(law.learned[place]);
        }
    }
    return 0;
}
