// Sums of sinusoids in the rotor's angle, computed with a single sine and cosine.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <stdexcept>
#include <vector>

namespace cogless {

struct Complex {
    double re, im;
};

inline Complex operator*(Complex a, Complex b) {
    return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

// e^{j n theta} for a set of orders n. All are products of e^{j g theta}, g the orders' greatest common divisor, in an order
// planned once.
class Powers {
public:
    static constexpr std::size_t capacity = 128;
    using Values = std::array<Complex, capacity>;

    Powers() = default;

    explicit Powers(std::vector<int> orders) {
        std::sort(orders.begin(), orders.end());
        for (const int order : orders) base_ = std::gcd(base_, order);
        multiples_.push_back(1);
        for (const int order : orders) place_of(order / base_);
    }

    // The index at which evaluate() stores e^{j order theta}; the order must be among those given.
    std::size_t place(int order) const {
        return static_cast<std::size_t>(std::find(multiples_.begin(), multiples_.end(), order / base_) -
                                        multiples_.begin());
    }

    [[gnu::always_inline]] void evaluate(double theta, Values& z) const {
        const double angle = base_ * theta;
        Complex last{std::cos(angle), std::sin(angle)};
        std::size_t n = 0;
        z[n] = last;
        for (const Product& p : products_) {
            // mostly a chain in which each product needs the last one, so the last one is kept in registers
            Complex a = last, b = last;
            if (p.a != n) a = z[p.a];
            if (p.b != n) b = z[p.b];
            last = a * b;
            z[++n] = last;
        }
    }

private:
    struct Product {
        std::size_t a, b;
    };

    std::size_t append(std::size_t a, std::size_t b) {
        if (multiples_.size() == capacity) throw std::invalid_argument("too many different orders");
        products_.push_back({a, b});
        multiples_.push_back(multiples_[a] + multiples_[b]);
        return multiples_.size() - 1;
    }

    std::size_t place_of(int multiple) {
        for (std::size_t a = 0; a < multiples_.size(); ++a) {
            if (multiples_[a] == multiple) return a;
        }
        for (std::size_t a = 0; a < multiples_.size(); ++a) {
            for (std::size_t b = 0; b <= a; ++b) {
                if (multiples_[a] + multiples_[b] == multiple) return append(a, b);
            }
        }
        const std::size_t half = place_of(multiple / 2);
        const std::size_t doubled = multiple % 2 == 0 ? 0 : place_of(multiple - 1);
        return multiple % 2 == 0 ? append(half, half) : append(doubled, 0);
    }

    int base_ = 0;
    std::vector<int> multiples_;
    std::vector<Product> products_;
};

// amplitude sin(order theta + phase); order: waves per mechanical revolution
struct Harmonic {
    int order;
    double amplitude, phase;
};

// A sum of harmonics over evaluated powers.
class Series {
public:
    Series() = default;

    Series(const Powers& powers, const std::vector<Harmonic>& harmonics) {
        for (const Harmonic& h : harmonics) {
            terms_.push_back({powers.place(h.order), h.order, h.amplitude * std::cos(h.phase),
                              h.amplitude * std::sin(h.phase)});
        }
    }

    double value(const Powers::Values& z) const {
        double sum = 0.0;
        for (const Term& t : terms_) sum += t.in_sine * z[t.place].im + t.in_cosine * z[t.place].re;
        return sum;
    }

    // the integral over theta, without the constant of integration
    double integral(const Powers::Values& z) const {
        double sum = 0.0;
        for (const Term& t : terms_) sum += (t.in_cosine * z[t.place].im - t.in_sine * z[t.place].re) / t.order;
        return sum;
    }

private:
    struct Term {
        std::size_t place;
        int order;
        double in_sine, in_cosine;
    };
    std::vector<Term> terms_;
};

}  // namespace cogless
