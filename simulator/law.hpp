// What a law sees, asks for and has learned, whichever it is.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "cogless/status.h"

namespace cogless {

// Currents that a law asks for, A, and its status bits.
struct Command {
    double i_d_ref = 0.0, i_q_ref = 0.0;
    unsigned status = 0;
};

// What the engine offers a law, in doubles.
struct LawInput {
    double time;              // s
    double omega_ref;         // rad/s; in trials the angle, rad
    double omega_m, theta_m;  // measured: rad/s, rad
    double i_d, i_q;          // measured, A
    double i_limit;           // A, of the current reference
    double ts;                // s, speed-loop period
    bool learn;               // false: hold what is learned
};

enum class Over { mechanical, electrical, trial };

// What a law has learned: currents, A, over a revolution, or a signal, rad, over a trial's samples.
struct Learned {
    std::vector<double> values;
    Over over = Over::mechanical;
};

// Throws std::invalid_argument where a law's init refuses.
inline void require(cgl_error error, const char* law) {
    if (error == CGL_ERROR_MEMORY) throw std::invalid_argument(std::string(law) + ": memory too small");
    if (error != CGL_OK) throw std::invalid_argument(std::string(law) + ": a gain is outside its range");
}

}  // namespace cogless
