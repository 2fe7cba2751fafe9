// A table of the configuration, read from a Python dict; errors name the whole key.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "cogless/real.h"
#include "inverter.hpp"
#include "table.hpp"

namespace cogless {

class Section {
public:
    Section(nanobind::dict values, std::string name) : values_(std::move(values)), name_(std::move(name)) {}

    bool has(const char* key) const { return values_.contains(key) && !values_[key].is_none(); }

    template <class T>
    T get(const char* key) const {
        if (!values_.contains(key)) refuse(key, "missing");
        T value;
        if (!nanobind::try_cast<T>(values_[key], value)) refuse(key, "wrong type");
        return value;
    }

    double number(const char* key) const { return get<double>(key); }
    int integer(const char* key) const { return get<int>(key); }
    cgl_real real(const char* key) const { return static_cast<cgl_real>(number(key)); }

    // So many finite numbers.
    std::vector<double> numbers(const char* key, std::size_t count) const {
        auto values = get<std::vector<double>>(key);
        if (values.size() != count) refuse(key, "expected " + std::to_string(count) + " numbers");
        for (const double value : values) {
            if (!std::isfinite(value)) refuse(key, "expected finite numbers");
        }
        return values;
    }

    [[noreturn]] void refuse(const char* key, const std::string& why) const {
        throw std::invalid_argument(name_ + key + ": " + why);
    }

    template <class Choice>
    Choice choice(const char* key, const std::map<std::string, Choice>& choices) const {
        const auto found = choices.find(get<std::string>(key));
        if (found == choices.end()) refuse(key, "unknown");
        return found->second;
    }

    Section section(const char* key) const { return {get<nanobind::dict>(key), name_ + key + "."}; }

    std::vector<Section> sections(const char* key) const {
        std::vector<Section> all;
        for (const nanobind::handle item : get<nanobind::list>(key)) {
            all.emplace_back(nanobind::cast<nanobind::dict>(item), name_ + key + "." + std::to_string(all.size()) + ".");
        }
        return all;
    }

    Table table(const char* key, const char* axis, const char* value) const {
        if (!has(key)) return {};
        const Section s = section(key);
        return {s.get<std::vector<double>>(axis), s.get<std::vector<double>>(value)};
    }

    Phases phases(const char* key) const {
        const auto values = get<std::vector<double>>(key);
        if (values.size() != 3) refuse(key, "expected three values");
        return {values[0], values[1], values[2]};
    }

private:
    nanobind::dict values_;
    std::string name_;
};

}  // namespace cogless
