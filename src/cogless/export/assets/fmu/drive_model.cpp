// The whole drive as a model: the simulator's own engine, one current-loop period a step.
//
// At each communication point the period from there on is run ahead, with the inputs as they are, since what the drive
// measures and records at that point comes from it; where an input is then changed before the step, it is run again.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <exception>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "config.hpp"
#include "drive.hpp"
#include "drive_variables.hpp"
#include "fmu.h"
#include "state_bytes.hpp"

// A controller whose output is an importer's duty cycles.
class Outside : public cogless::Controller {
public:
    cgl_drive_output output{};

    cgl_drive_output step(const cgl_measurement&, const cgl_reference&) override { return output; }
    std::pair<bool, cogless::Measurement> measure(const cgl_measurement&, const cgl_reference&) override { return {}; }
    cogless::BusCommand law(const cogless::Measurement&) override { return {}; }
    cgl_drive_output actuate(const cogless::BusCommand*) override { return output; }
    void begin(const std::vector<cgl_real>&) override {}
    void end() override {}
};

struct fmu_model {
    std::optional<cogless::Drive> drive;
    bool external;  // the inputs' duties or current act
    Outside outside;
    cogless::DriveState now, next;  // at the communication point; one period later
    std::vector<double> used;       // the inputs that `next` was run with
};

namespace {

using cogless::Drive;
using cogless::DriveState;

// Value of an optional variable; its place is 0 where this FMU has none.
double of(const double value[], int place, double otherwise) { return place == 0 ? otherwise : value[place]; }

void apply_inputs(const Drive& drive, DriveState& state, const double value[]) {
    drive.add_load(state, value[FMU_LOAD_ADDED]);
    if (of(value, FMU_EXTERNAL_REFERENCE, 0.0) != 0.0) {
        state.given_reference = {of(value, FMU_THETA_REF_INPUT, 0.0), value[FMU_OMEGA_REF_INPUT],
                                 of(value, FMU_ALPHA_REF_INPUT, 0.0)};
    }
}

cgl_real real(double x) { return static_cast<cgl_real>(x); }

// Output of a controller that the inputs ask for.
cgl_drive_output asked_for(const double value[]) {
    cgl_drive_output output{};
    output.duty[0] = real(of(value, FMU_DUTY_A, 0.5));
    output.duty[1] = real(of(value, FMU_DUTY_B, 0.5));
    output.duty[2] = real(of(value, FMU_DUTY_C, 0.5));
    output.i_q_ref = real(of(value, FMU_I_Q_REF_INPUT, 0.0));
    if (of(value, FMU_BRIDGE_OPEN, 0.0) != 0.0) output.status = static_cast<unsigned>(CGL_STATUS_OFF);
    return output;
}

// Inputs of a controller at the start of the period that was run.
void put_measurements(const DriveState& state, double value[]) {
    const cgl_measurement& now = state.sampled;
    const cgl_reference& asked = state.asked;
    const auto put = [value](int place, auto x) {
        if (place != 0) value[place] = static_cast<double>(x);
    };
    put(FMU_I_A, now.i_abc[0]);
    put(FMU_I_B, now.i_abc[1]);
    put(FMU_I_C, now.i_abc[2]);
    put(FMU_THETA_M, now.theta_m);
    put(FMU_OMEGA_M, now.omega_m);
    put(FMU_U_DC, now.u_dc);
    put(FMU_THETA_REF, asked.theta_ref);
    put(FMU_OMEGA_REF, asked.omega_ref);
    put(FMU_ALPHA_REF, asked.alpha_ref);
    put(FMU_I_D_REF, asked.i_d_ref);
    put(FMU_LEARN, asked.learn);
}

std::vector<double> inputs_in(const double value[]) { return {value + FMU_FIRST_INPUT, value + FMU_FIRST_OUTPUT}; }

// Refuses an input that is NaN or infinite: the plant would only show it as a current beyond all numbers, and
// the bridge as half a duty.
void require_finite(const double value[]) {
    for (std::size_t place = FMU_FIRST_INPUT; place < FMU_FIRST_OUTPUT; ++place) {
        if (!std::isfinite(value[place])) {
            throw std::runtime_error(std::string(fmu_variables[place].name) + ": expected a finite number");
        }
    }
}

bool has_ended(const DriveState& state) { return FMU_LAST_TICK > 0 && state.tick >= FMU_LAST_TICK; }

// Runs the period from `now` on to `next`, and puts what is measured and recorded at its start into `value`.
void run_ahead(fmu_model& model, double value[]) {
    require_finite(value);
    model.used = inputs_in(value);
    if (has_ended(model.now)) return;
    model.next = model.now;
    apply_inputs(*model.drive, model.next, value);
    cogless::Recorder recorder(model.drive->signals().size(), 1, 1);
    model.outside.output = asked_for(value);
    model.drive->advance(model.next, recorder, 1, model.external ? &model.outside : nullptr);
    const cogless::Rows row = recorder.take();
    // the first is the time; rows within the period may follow
    std::copy_n(row.begin() + 1, model.drive->signals().size() - 1, value + FMU_FIRST_SIGNAL);
    put_measurements(model.next, value);
}

// Runs something that may throw as a C function.
template <class Action>
bool attempt(char why[FMU_WHY], const Action& action) {
    try {
        action();
        return true;
    } catch (const std::exception& error) {
        std::snprintf(why, FMU_WHY, "%s", error.what());
        return false;
    }
}

void start(fmu_model& model, double value[]) {
    cogless::DriveConfig config = cogless::read_config(description());
    model.external = value[FMU_EXTERNAL_CONTROL] != 0.0;
    if (model.external) config.inverter.computation_delay = false;  // such a delay is the other controller's
    model.drive.emplace(config);
    model.now = model.drive->start();
    const std::vector<double> table = taught();
    if (!table.empty()) std::transform(table.begin(), table.end(), model.drive->cells(model.now)->begin(), real);
    run_ahead(model, value);
}

}  // namespace

extern "C" {

fmu_model* fmu_model_new(char why[FMU_WHY]) {
    fmu_model* model = nullptr;
    attempt(why, [&] { model = new fmu_model; });
    return model;
}

void fmu_model_free(fmu_model* model) { delete model; }

bool fmu_model_start(fmu_model* model, double value[], char why[FMU_WHY]) {
    return attempt(why, [&] { start(*model, value); });
}

bool fmu_model_step(fmu_model* model, double value[], char why[FMU_WHY]) {
    return attempt(why, [&] {
        if (has_ended(model->now)) throw std::runtime_error("the study's trials are over");
        if (inputs_in(value) != model->used) run_ahead(*model, value);
        std::swap(model->now, model->next);
        run_ahead(*model, value);
    });
}

size_t fmu_model_save(const fmu_model* model, unsigned char* to) {
    cogless::StateWriter writer(to);
    if (model->drive) cogless::archive(writer, const_cast<DriveState&>(model->now));
    return writer.size();
}

bool fmu_model_load(fmu_model* model, double value[], const unsigned char* from, size_t size, char why[FMU_WHY]) {
    return attempt(why, [&] {
        if (size == 0) {
            model->drive.reset();
            return;
        }
        std::vector<double> scratch(value, value + fmu_variable_count);
        start(*model, scratch.data());
        cogless::StateReader reader(from, size);
        cogless::archive(reader, model->now);
        if (!reader.complete()) throw std::runtime_error("this is no state of this FMU");
        run_ahead(*model, scratch.data());
    });
}

}  // extern "C"
