// Rows of named signals, one row every `decimation` current-loop periods.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "every.hpp"

namespace cogless {

struct Signal {
    std::string name, unit;
};

class Recorder {
public:
    // rows: the expected number. More rows are recorded too, but then memory is allocated.
    Recorder(std::size_t columns, std::int64_t decimation, std::size_t rows)
        : columns_(columns), decimation_(decimation) {
        data_.reserve(rows * columns);
    }

    bool wants(std::int64_t tick) const { return tick % decimation_ == 0; }
    // The same of each tick from `first` on.
    Every rows(std::int64_t first) const { return {decimation_, first}; }

    // Reserves memory for a run of `ticks` periods, so that nothing is allocated within it.
    void reserve(std::int64_t ticks) {
        const auto rows = static_cast<std::size_t>(ticks / decimation_ + 1);
        const std::size_t needed = data_.size() + rows * columns_;
        if (needed > data_.capacity()) data_.reserve(std::max(needed, 2 * data_.capacity()));
    }

    double* next_row() {
        data_.resize(data_.size() + columns_);
        return data_.data() + data_.size() - columns_;
    }

    std::size_t columns() const { return columns_; }

    // Returns the recorded rows, and starts with an empty record.
    std::vector<double> take() { return std::exchange(data_, {}); }

private:
    std::size_t columns_;
    std::int64_t decimation_;
    std::vector<double> data_;
};

}  // namespace cogless
