// A description as a plain tree of values. The bindings make it from Python's dicts, PackedValue makes it in a page, and generated
// C++ makes it in an FMU.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace cogless {

class Value {
public:
    using Numbers = std::vector<double>;
    using List = std::vector<Value>;
    using Table = std::map<std::string, Value>;
    // A matrix, row by row.
    struct Matrix {
        std::size_t rows, columns;
        Numbers data;
    };
    // A type that no key accepts.
    struct Other {};

    Value() = default;  // none
    Value(bool value) : data_(value) {}
    Value(double value) : data_(value) {}
    template <std::integral Integer>
    Value(Integer value) {
        if (std::in_range<std::int64_t>(value)) {
            data_ = static_cast<std::int64_t>(value);
        } else {
            data_ = static_cast<std::uint64_t>(value);
        }
    }
    Value(const char* value) : data_(std::string(value)) {}
    Value(std::string value) : data_(std::move(value)) {}
    Value(Numbers value) : data_(std::move(value)) {}
    Value(List value) : data_(std::move(value)) {}
    Value(Table value) : data_(std::move(value)) {}
    Value(Matrix value) : data_(std::move(value)) {}
    Value(Other value) : data_(value) {}

    bool is_none() const { return std::holds_alternative<std::monostate>(data_); }

    // The table or list in this value, or null.
    template <class T>
    const T* as() const {
        return std::get_if<T>(&data_);
    }

    // Returns false, and leaves `to` unchanged, if the value is of another kind or out of range.
    bool read(bool& to) const { return take(to); }
    bool read(std::string& to) const { return take(to); }
    bool read(Matrix& to) const { return take(to); }

    template <std::integral Integer>
    bool read(Integer& to) const {
        if (const auto* b = as<bool>()) return assign(to, static_cast<int>(*b));
        if (const auto* n = as<std::int64_t>()) return assign(to, *n);
        if (const auto* n = as<std::uint64_t>()) return assign(to, *n);
        return false;
    }

    bool read(double& to) const {
        if (take(to)) return true;
        if (const auto* n = as<std::uint64_t>()) {
            to = static_cast<double>(*n);
            return true;
        }
        std::int64_t integer;
        if (!read(integer)) return false;
        to = static_cast<double>(integer);
        return true;
    }

    bool read(Numbers& to) const { return take(to) || read_list(to); }
    bool read(std::vector<Numbers>& to) const {
        const auto* matrix = as<Matrix>();
        if (matrix == nullptr) return read_list(to);
        to.clear();
        for (auto row = matrix->data.begin(); row != matrix->data.end(); row += static_cast<std::ptrdiff_t>(matrix->columns)) {
            to.emplace_back(row, row + static_cast<std::ptrdiff_t>(matrix->columns));
        }
        return true;
    }

private:
    using Data = std::variant<std::monostate, bool, std::int64_t, std::uint64_t, double, std::string, Numbers, List, Table,
                              Matrix, Other>;

    template <class Item>
    bool read_list(std::vector<Item>& to) const {
        const auto* list = as<List>();
        if (list == nullptr) return false;
        std::vector<Item> items(list->size());
        for (std::size_t n = 0; n < items.size(); ++n) {
            if (!(*list)[n].read(items[n])) return false;
        }
        to = std::move(items);
        return true;
    }

    template <class T>
    bool take(T& to) const {
        const T* value = as<T>();
        if (value != nullptr) to = *value;
        return value != nullptr;
    }

    template <class To, class From>
    static bool assign(To& to, From from) {
        if (!std::in_range<To>(from)) return false;
        to = static_cast<To>(from);
        return true;
    }

    Data data_;
};

}  // namespace cogless
