// Reads a description from the flat bytes in which a page hands it to the engine. src/cogless/live/description.py writes them.
//
// Little-endian. A value is a kind (u32), a count (u32) and its data, padded to 8 bytes, so that every number keeps its place
// whatever the other numbers are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>

#include "value.hpp"

namespace cogless {

class PackedValue {
public:
    // Throws std::invalid_argument for bytes that are no value.
    static Value read(std::string_view bytes) {
        PackedValue packed(bytes);
        return packed.value();
    }

private:
    enum Kind : std::uint32_t { none, boolean, integer, natural, real, text, numbers, list, table, matrix };

    explicit PackedValue(std::string_view bytes) : bytes_(bytes) {}

    std::string_view take(std::size_t size) {
        if (size > bytes_.size()) throw std::invalid_argument("description: too short");
        const std::string_view found = bytes_.substr(0, size);
        bytes_.remove_prefix(size + (8 - size % 8) % 8);
        return found;
    }

    template <class T>
    T plain() {
        T number;
        std::memcpy(&number, take(sizeof number).data(), sizeof number);
        return number;
    }

    std::string string(std::size_t size) { return std::string(take(size)); }

    Value::Numbers reals(std::size_t count) {
        if (count > bytes_.size() / sizeof(double)) throw std::invalid_argument("description: too short");
        Value::Numbers all(count);
        const std::string_view from = take(count * sizeof(double));
        if (count > 0) std::memcpy(all.data(), from.data(), from.size());
        return all;
    }

    Value value() {
        struct Head {
            std::uint32_t kind, count;
        };
        const auto [kind, count] = plain<Head>();
        switch (kind) {
            case none: return {};
            case boolean: return count != 0;
            case integer: return plain<std::int64_t>();
            case natural: return plain<std::uint64_t>();
            case real: return plain<double>();
            case text: return string(count);
            case numbers: return reals(count);
            case list: {
                Value::List items;
                for (std::uint32_t n = 0; n < count; ++n) items.push_back(value());
                return items;
            }
            case table: {
                Value::Table members;
                for (std::uint32_t n = 0; n < count; ++n) {
                    std::string name = string(static_cast<std::size_t>(plain<std::uint64_t>()));
                    members.emplace(std::move(name), value());
                }
                return members;
            }
            case matrix: {
                const auto columns = static_cast<std::size_t>(plain<std::uint64_t>());
                return Value::Matrix{count, columns, reals(count * columns)};
            }
            default: throw std::invalid_argument("description: no such kind of value");
        }
    }

    std::string_view bytes_;
};

}  // namespace cogless
