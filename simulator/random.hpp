// Random numbers that are the same on every machine: SplitMix64, and the ziggurat method for normal ones.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "maths.hpp"

namespace cogless {

// The next bits of SplitMix64, or those of several at once, whose states are a vector.
template <class State>
[[gnu::always_inline]] inline State next_bits(State& state) {
    state += 0x9e3779b97f4a7c15U;
    State z = state;
    z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31U);
}

class Random {
public:
    explicit Random(std::uint64_t seed) : state_(seed) {}

    std::uint64_t state() const { return state_; }

    std::uint64_t bits() { return next_bits(state_); }

    // Advances as if `count` numbers had been drawn.
    void skip(std::uint64_t count) { state_ += count * 0x9e3779b97f4a7c15U; }

    // A number in (0, 1], evenly distributed.
    double uniform() { return static_cast<double>((bits() >> 11U) + 1) * 0x1p-53; }

private:
    std::uint64_t state_;
};

// Draws from the normal distribution of mean 0 and standard deviation 1, by layers of equal area (Marsaglia, Tsang: The ziggurat
// method for generating random variables, 2000). Nearly all draws take one multiplication and one comparison.
class Normal {
public:
    static constexpr std::size_t layers = 128;

    struct Point {
        std::size_t layer;
        double x;
    };

    // A point's x from its edge and a number's 53 bits.
    template <class Real>
    [[gnu::always_inline]] static Real x_of(const Real& bits, const Real& edge) {
        return (bits * 0x1p-52 - 1.0) * edge;
    }

    Normal() {
        edge_[0] = area / density(tail);
        edge_[1] = tail;
        for (std::size_t n = 2; n < layers; ++n) {
            edge_[n] = std::sqrt(-2.0 * logarithm(area / edge_[n - 1] + density(edge_[n - 1])));
        }
        edge_[layers] = 0.0;
        for (std::size_t n = 0; n <= layers; ++n) density_[n] = density(edge_[n]);
    }

    [[gnu::always_inline]] double draw(Random& random) const {
        const Point p = point(random);
        return is_inside(p) ? p.x : at_edge(random, p);
    }

    // The edges of the layers. A point of layer n is inside if |x| is below edge n + 1.
    const double* edges() const { return edge_.data(); }

    // The draw from a point that may lie above the density. While it does, another point is drawn.
    [[gnu::noinline]] double at_edge(Random& random, Point p) const {
        while (!is_inside(p)) {
            if (p.layer == 0) return beyond_tail(random, p.x);
            const double from = density_[p.layer], to = density_[p.layer + 1];
            if (from + random.uniform() * (to - from) < density(p.x)) break;
            p = point(random);
        }
        return p.x;
    }

private:
    static constexpr double tail = 3.442619855899, area = 9.91256303526217e-3;  // start of the tail, area of one of 128 layers (the paper)

    [[gnu::always_inline]] Point point(Random& random) const {
        const std::uint64_t bits = random.bits();
        const std::size_t layer = bits % layers;
        return {layer, x_of(static_cast<double>(bits >> 11U), edge_[layer])};
    }

    [[gnu::always_inline]] bool is_inside(Point p) const { return std::abs(p.x) < edge_[p.layer + 1]; }

    static double density(double x) { return exponential(-0.5 * x * x); }

    static double beyond_tail(Random& random, double sign) {
        for (;;) {
            const double a = -logarithm(random.uniform()) / tail, b = -logarithm(random.uniform());
            if (2.0 * b >= a * a) return std::copysign(tail + a, sign);
        }
    }

    std::array<double, layers + 1> edge_, density_;
};

}  // namespace cogless
