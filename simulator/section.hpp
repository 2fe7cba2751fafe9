// Reads a table of the configuration; errors name the key with its full path.
#pragma once

#include <cmath>
#include <cstring>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "cogless/real.h"
#include "inverter.hpp"
#include "table.hpp"
#include "value.hpp"

namespace cogless {

// A C struct from its bytes in this machine's layout. src/cogless/c_layout.py makes the bytes; a bool among them is 0 or 1. Throws
// std::invalid_argument for another size.
template <class Struct>
Struct struct_of(std::string_view bytes, const std::string& name) {
    if (bytes.size() != sizeof(Struct)) {
        throw std::invalid_argument(name + ": " + std::to_string(bytes.size()) + " bytes: expected " +
                                    std::to_string(sizeof(Struct)));
    }
    Struct value;
    std::memcpy(&value, bytes.data(), sizeof value);
    return value;
}

// A view of a description; the description must outlive the view.
class Section {
public:
    Section(const Value& description, std::string name)
        : values_(description.as<Value::Table>()), name_(std::move(name)) {
        if (values_ == nullptr) throw std::invalid_argument(name_ + ": wrong type");
    }

    bool has(const char* key) const {
        const Value* value = find(key);
        return value != nullptr && !value->is_none();
    }

    template <class T>
    T get(const char* key) const {
        T value;
        if (!at(key).read(value)) refuse(key, "wrong type");
        return value;
    }

    double number(const char* key) const { return get<double>(key); }
    int integer(const char* key) const { return get<int>(key); }

    template <class Struct>
    Struct packed(const char* key) const {
        return struct_of<Struct>(get<std::string>(key), name_ + key);
    }

    // A list of exactly `count` finite numbers.
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

    Section section(const char* key) const {
        const auto* table = at(key).as<Value::Table>();
        if (table == nullptr) refuse(key, "wrong type");
        return {*table, name_ + key + "."};
    }

    std::vector<Section> sections(const char* key) const {
        const auto* list = at(key).as<Value::List>();
        if (list == nullptr) refuse(key, "wrong type");
        std::vector<Section> all;
        for (const Value& item : *list) {
            const auto* table = item.as<Value::Table>();
            if (table == nullptr) refuse(key, "wrong type");
            all.push_back({*table, name_ + key + "." + std::to_string(all.size()) + "."});
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
    Section(const Value::Table& values, std::string name) : values_(&values), name_(std::move(name)) {}

    const Value* find(const char* key) const {
        const auto found = values_->find(key);
        return found == values_->end() ? nullptr : &found->second;
    }

    const Value& at(const char* key) const {
        const Value* value = find(key);
        if (value == nullptr) refuse(key, "missing");
        return *value;
    }

    const Value::Table* values_;
    std::string name_;
};

}  // namespace cogless
