// Writes the first 2000 rows of a described run's trace to the standard output, as doubles.
#include <cstdio>

#include "config.cpp"
#include "drive.cpp"
#include "drive_variables.hpp"
#include "plant_steps.cpp"
#include "trial_config.cpp"

int main() {
    constexpr std::int64_t ticks = 2000;
    const cogless::Drive drive(cogless::read_config(description()));
    cogless::DriveState state = drive.start();
    cogless::Recorder recorder(drive.signals().size(), 1, ticks);
    drive.advance(state, recorder, ticks);
    const cogless::Rows rows = recorder.take();
    return std::fwrite(rows.data(), sizeof(double), rows.size(), stdout) == rows.size() ? 0 : 1;
}
