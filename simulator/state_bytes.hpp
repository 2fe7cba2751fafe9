// Converts a drive's state to bytes and back, to keep it outside this process. The bytes fit only the same machine and the
// same description.
//
// Each structure is unpacked into all of its members, so a new member that is forgotten here does not compile. The pointers
// in the C structures are not valid afterwards: they are set again before each use.
#pragma once

#include <cstddef>
#include <cstring>
#include <type_traits>
#include <variant>
#include <vector>

#include "drive.hpp"

namespace cogless {

// Counts the bytes, and writes them if a buffer is given.
class StateWriter {
public:
    explicit StateWriter(unsigned char* to) : to_(to) {}

    void bytes(void* from, std::size_t size) {
        if (to_ != nullptr && size > 0) std::memcpy(to_ + size_, from, size);
        size_ += size;
    }
    template <class T>
    void vector(std::vector<T>& values) {
        std::size_t count = values.size();
        bytes(&count, sizeof count);
        bytes(values.data(), count * sizeof(T));
    }
    std::size_t size() const { return size_; }

private:
    unsigned char* to_;
    std::size_t size_ = 0;
};

// Reads bytes into a state of the shape that was written; complete() returns whether the bytes fitted it.
class StateReader {
public:
    StateReader(const unsigned char* from, std::size_t size) : from_(from), left_(size) {}

    void bytes(void* to, std::size_t size) {
        if (size > left_) whole_ = false;
        if (!whole_ || size == 0) return;
        std::memcpy(to, from_, size);
        from_ += size;
        left_ -= size;
    }
    template <class T>
    void vector(std::vector<T>& values) {
        std::size_t count = 0;
        bytes(&count, sizeof count);
        if (count != values.size()) whole_ = false;
        bytes(values.data(), values.size() * sizeof(T));
    }
    bool complete() const { return whole_ && left_ == 0; }

private:
    const unsigned char* from_;
    std::size_t left_;
    bool whole_ = true;
};

template <class Archive, class T>
    requires std::is_trivially_copyable_v<T>
void archive(Archive& a, T& value) {
    a.bytes(&value, sizeof value);
}

template <class Archive, class T>
void archive(Archive& a, std::vector<T>& values) {
    a.vector(values);
}

template <class Archive>
void archive(Archive& a, PositionSensor::State& s) {
    auto& [theta_before, count, omega_m, edges, counted, timed, encoder, observer, hall, past, newest, before] = s;
    const auto all = [&a](auto&... members) { (archive(a, members), ...); };
    all(theta_before, count, omega_m, edges, counted, timed, encoder, observer, hall, past, newest, before);
}

template <class Archive>
void archive(Archive& a, Bus::State& s) {
    auto& [past, newest, sent, first, waiting, random] = s;
    const auto all = [&a](auto&... members) { (archive(a, members), ...); };
    all(past, newest, sent, first, waiting, random);
}

// State of a law that learns over an angle.
template <class Archive, class State>
    requires(!std::is_trivially_copyable_v<State>) && requires(State& s) { s.cell; }
void archive(Archive& a, State& s) {
    auto& [law, cell] = s;
    archive(a, law);
    archive(a, cell);
}

template <class Archive>
void archive(Archive& a, TrialLaw::State& s) {
    auto& [law, cell, reference, input] = s;
    archive(a, law);
    archive(a, cell);
    archive(a, reference);
    archive(a, input);
}

template <class Archive>
void archive(Archive& a, LawState& s) {
    std::visit([&a](auto& law) { archive(a, law); }, s);
}

template <class Archive>
void archive(Archive& a, DriveState& s) {
    auto& [tick, plant, position, random, control, dead_time, encoder_table, speed_filter, bus, law, seen, measured, reference_filter, reference, sampled, asked,
           output, duty, applied, open, next_load_step, added_load, load_deviation, temperature, given_reference] = s;
    const auto all = [&a](auto&... members) { (archive(a, members), ...); };
    all(tick, plant, position, random, control, dead_time, encoder_table, speed_filter, bus, law, seen, measured, reference_filter, reference, sampled, asked, output,
        duty, applied, open, next_load_step, added_load, load_deviation, temperature, given_reference);
}

}  // namespace cogless
