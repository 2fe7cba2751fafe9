// Rows of named signals, one row every `decimation` current-loop periods.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "every.hpp"
#include "row_memory.hpp"

namespace cogless {

struct Signal {
    std::string name, unit;
};

class Recorder {
public:
    // rows: the expected number. More rows are recorded too, but then memory is allocated. selected: the only columns that are
    // recorded, in this order; empty: all.
    Recorder(std::size_t columns, std::int64_t decimation, std::size_t rows, std::vector<std::size_t> selected = {})
        : columns_(selected.empty() ? columns : selected.size()), decimation_(decimation), data_(rows * columns_),
          selected_(std::move(selected)), whole_(selected_.empty() ? 0 : columns) {}

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

    // The caller writes all columns to the memory that is returned, before the next call of this object.
    double* next_row() {
        if (selected_.empty()) return next();
        select();
        written_ = true;
        return whole_.data();
    }

    // The number of recorded columns.
    std::size_t columns() const { return columns_; }

    // Returns the recorded rows, and starts with an empty record.
    Rows take() {
        select();
        data_.resize(std::exchange(used_, 0));
        return std::exchange(data_, {});
    }

private:
    std::int64_t rows_before(std::int64_t tick) const { return (tick + decimation_ - 1) / decimation_; }

    double* next() {
        if (used_ + columns_ > data_.size()) grow(used_ + columns_);
        used_ += columns_;
        return data_.data() + used_ - columns_;
    }

    // Records the selected columns of the last row.
    void select() {
        if (!std::exchange(written_, false)) return;
        double* row = next();
        for (const std::size_t column : selected_) *row++ = whole_[column];
    }

    void grow(std::size_t needed) { data_.resize(std::max(needed, 2 * data_.size())); }

    std::size_t columns_;
    std::int64_t decimation_;
    Rows data_;
    std::size_t used_ = 0;  // numbers of data_ that are recorded
    std::vector<std::size_t> selected_;
    std::vector<double> whole_;  // the last row, of all columns, where some are selected
    bool written_ = false;       // whether whole_ has a row that is not yet in data_
};

}  // namespace cogless
