// Rows of named signals, one row every `decimation` current-loop periods.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "every.hpp"
#include "row_memory.hpp"

namespace cogless {

struct Signal {
    std::string name, unit;
};

class Recorder {
public:
    // rows: the expected number. More rows are recorded too, but then memory is allocated.
    Recorder(std::size_t columns, std::int64_t decimation, std::size_t rows)
        : columns_(columns), decimation_(decimation), data_(rows * columns) {}

    bool wants(std::int64_t tick) const { return tick % decimation_ == 0; }
    // wants() for one tick after another from `first` on.
    Every rows(std::int64_t first) const { return {decimation_, first}; }

    // Reserves memory for a run of `ticks` periods from `first` on, so that nothing is allocated within the run. per_period: rows of
    // a period in which one is due.
    void reserve(std::int64_t first, std::int64_t ticks, int per_period = 1) {
        const std::int64_t due = rows_before(first + ticks) - rows_before(first);
        const std::size_t needed = used_ + static_cast<std::size_t>(due * per_period) * columns_;
        if (needed > data_.size()) grow(needed);
    }

    double* next_row() {
        if (used_ + columns_ > data_.size()) grow(used_ + columns_);
        used_ += columns_;
        return data_.data() + used_ - columns_;
    }

    std::size_t columns() const { return columns_; }

    // Returns the recorded rows, and starts with an empty record.
    Rows take() {
        data_.resize(std::exchange(used_, 0));
        return std::exchange(data_, {});
    }

private:
    std::int64_t rows_before(std::int64_t tick) const { return (tick + decimation_ - 1) / decimation_; }

    void grow(std::size_t needed) { data_.resize(std::max(needed, 2 * data_.size())); }

    std::size_t columns_;
    std::int64_t decimation_;
    Rows data_;
    std::size_t used_ = 0;  // numbers of data_ that are recorded
};

}  // namespace cogless
