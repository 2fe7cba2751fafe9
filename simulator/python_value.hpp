// Converts Python values to the plain tree of values from which the engine reads its description.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include "value.hpp"

namespace cogless {

inline Value value_of(nanobind::handle object);

inline Value integer_of(nanobind::handle object) {
    std::int64_t number;
    if (nanobind::try_cast(object, number)) return number;
    std::uint64_t large;
    if (nanobind::try_cast(object, large)) return large;
    return Value::Other{};
}

// Converts a list, a tuple or an array of one dimension.
inline Value list_of(nanobind::handle object) {
    Value::List list;
    for (const nanobind::handle item : object) list.push_back(value_of(item));
    return list;
}

inline Value table_of(const nanobind::dict& object) {
    Value::Table table;
    for (const auto& [key, value] : object) {
        std::string name;
        if (!nanobind::try_cast(key, name)) return Value::Other{};
        table.emplace(std::move(name), value_of(value));
    }
    return table;
}

// Converts a Python value. A value that no key accepts becomes Value::Other, which is an error only when its key is read.
inline Value value_of(nanobind::handle object) {
    using Matrix = nanobind::ndarray<const double, nanobind::ndim<2>, nanobind::c_contig, nanobind::device::cpu>;
    if (object.is_none()) return {};
    if (nanobind::isinstance<nanobind::bool_>(object)) return nanobind::cast<bool>(object);
    if (nanobind::isinstance<nanobind::float_>(object)) return nanobind::cast<double>(object);
    if (nanobind::isinstance<nanobind::str>(object)) return nanobind::cast<std::string>(object);
    if (nanobind::isinstance<nanobind::bytes>(object)) {
        const auto bytes = nanobind::borrow<nanobind::bytes>(object);
        return std::string(bytes.c_str(), bytes.size());
    }
    if (nanobind::isinstance<nanobind::dict>(object)) return table_of(nanobind::borrow<nanobind::dict>(object));
    Matrix matrix;
    if (nanobind::try_cast(object, matrix)) {
        return Value::Matrix{matrix.shape(0), matrix.shape(1), {matrix.data(), matrix.data() + matrix.size()}};
    }
    if (PySequence_Check(object.ptr()) != 0) return list_of(object);
    if (PyIndex_Check(object.ptr()) != 0) return integer_of(object);
    double number;
    if (nanobind::try_cast(object, number)) return number;
    return Value::Other{};
}

}  // namespace cogless
