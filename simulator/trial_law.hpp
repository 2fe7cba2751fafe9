// The control library's trial law as a value that an engine can run: begin, a step for each sample, end.
//
// The state has memory and reference. A copied state has its own ones, so the C state's pointers to them are set before each use.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "c_law.hpp"
#include "cogless/trial_basis.h"

namespace cogless {

struct TrialLaw : CLaw<trial_row> {
    struct State {
        cgl_trial law;
        std::vector<cgl_real> cell, reference;
        cgl_trial_input input;  // input of the last step, if the plant is not a drive
    };
    std::shared_ptr<const std::vector<cgl_real>> learning_matrix;  // null, or the matrix that config points to
    bool basis_functions = false;  // true: what is learned is carried over when the reference changes

    // Throws std::invalid_argument as CLaw does.
    static TrialLaw of(const Section& s, const cgl_loop& loop) {
        TrialLaw law;
        law.loop = loop;
        law.config = s.packed<cgl_trial_config>("config");
        law.config.learning_matrix = nullptr;
        law.basis_functions = s.has("basis_functions") && s.get<bool>("basis_functions");
        require_config<trial_row>(law.config, law.loop);
        if (s.has("learning_matrix")) {
            const auto matrix = s.get<Value::Matrix>("learning_matrix");
            if (matrix.rows != law.config.samples || matrix.columns != law.config.samples) {
                s.refuse("learning_matrix", "expected " + std::to_string(law.config.samples) + " rows and columns");
            }
            law.learning_matrix = std::make_shared<const std::vector<cgl_real>>(matrix.data.begin(), matrix.data.end());
            law.config.learning_matrix = law.learning_matrix->data();
        }
        return law;
    }

    State start() const {
        CLaw::State s = CLaw::start();
        return {s.law, std::move(s.cell), std::vector<cgl_real>(config.samples), {}};
    }

    // reference: one number for each sample.
    void begin(State& s, const std::vector<cgl_real>& reference) const {
        set_pointers(s);
        if (basis_functions && reference != s.reference) cgl_trial_carry(&s.law, reference.data());
        std::copy(reference.begin(), reference.end(), s.reference.begin());
        cgl_trial_begin(&s.law, s.reference.data());
    }

    // Steps the law by one sample of any plant, whose states are in s.input.
    cgl_trial_output step(State& s) const {
        cgl_trial_output output;
        set_pointers(s);
        cgl_trial_step(&s.law, &s.input, &output);
        return output;
    }

    // Steps the law by one sample of a drive.
    Command step(State& s, const cgl_law_input& in) const {
        cgl_law_output output;
        set_pointers(s);
        cgl_trial_drive_step(&s.law, &in, &output);
        return from_c(output);
    }

    void end(State& s) const {
        set_pointers(s);
        cgl_trial_end(&s.law);
    }

private:
    void set_pointers(State& s) const {
        s.law.learned = s.cell.data();
        s.law.error = s.law.learned + config.samples;
        s.law.y_ref = s.reference.data();
    }
};

}  // namespace cogless
