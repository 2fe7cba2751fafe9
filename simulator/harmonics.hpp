// Sums of sinusoids in the rotor's angle, computed with a single sine and cosine.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include "maths.hpp"
#include "wide.hpp"

namespace cogless {

// e^{j n theta} for a set of orders n. All are powers of e^{j g theta}, where g is the orders' greatest common divisor. The
// constructor plans the products that make them.
class Powers {
public:
    static constexpr std::size_t capacity = 128;
    template <class Real>
    using Values = std::array<Complex<Real>, capacity>;

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

    int highest_order() const { return base_ * *std::max_element(multiples_.begin(), multiples_.end()); }

    bool operator==(const Powers& other) const { return base_ == other.base_ && multiples_ == other.multiples_; }

    template <class Real>
    [[gnu::always_inline]] void evaluate(Real theta, Values<Real>& z) const {
        Complex<Real> last = unit_vector(static_cast<double>(base_) * theta);
        std::size_t n = 0;
        z[n] = last;
        for (const Product& p : products_) {
            // mostly a chain in which each product needs the last one, so the last one is kept in registers
            Complex<Real> a = last, b = last;
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
        if (multiples_.size() == capacity) {
            throw std::invalid_argument(
                "too many different orders in motor.cogging, torque_ripple and flux_harmonics, or in a load's harmonics: expected " +
                std::to_string(capacity) + " at most, the sums that lead to them included");
        }
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

// A sum of in_sine sin(order theta) + in_cosine cos(order theta) over evaluated powers.
template <class Real>
class Series {
public:
    Series() = default;

    // Several sums with the same orders, one for each lane.
    explicit Series(const Each<Series<double>, Real>& of)
        requires is_wide<Real>
    {
        for (std::size_t n = 0; n < of[0]->terms_.size(); ++n) {
            const auto& first = of[0]->terms_[n];
            terms_.push_back({first.place, first.order, each<Real>(of, [n](const auto& s) { return s.terms_[n].in_sine; }),
                              each<Real>(of, [n](const auto& s) { return s.terms_[n].in_cosine; })});
        }
    }

    bool alike(const Series& other) const {
        return std::ranges::equal(terms_, other.terms_, {}, &Term::place, &Term::place);
    }

    void add(const Powers& powers, int order, Real in_sine, Real in_cosine) {
        terms_.push_back({powers.place(order), static_cast<double>(order), in_sine, in_cosine});
    }
    void add(const Powers& powers, const Harmonic& h) {
        const Complex<double> unit = unit_vector(h.phase);
        add(powers, h.order, h.amplitude * unit.re, h.amplitude * unit.im);
    }

    // Sets this sum to another one of the same orders, times a factor.
    void scale(const Series& of, double factor) {
        for (std::size_t n = 0; n < terms_.size(); ++n) {
            terms_[n].in_sine = of.terms_[n].in_sine * factor;
            terms_[n].in_cosine = of.terms_[n].in_cosine * factor;
        }
    }

    bool empty() const { return terms_.empty(); }

    [[gnu::always_inline]] Real value(const Powers::Values<Real>& z) const {
        Real sum{};
        for (const Term& t : terms_) sum += t.in_sine * z[t.place].im + t.in_cosine * z[t.place].re;
        return sum;
    }

    // The first five Taylor coefficients: the n-th derivative over theta, divided by n!, for n = 0 to 4.
    [[gnu::always_inline]] std::array<Real, 5> taylor(const Powers::Values<Real>& z) const {
        std::array<Real, 5> sum{};
        for (const Term& t : terms_) {
            const Complex<Real> w = z[t.place];
            const Real f = t.in_sine * w.im + t.in_cosine * w.re, slope = t.order * (t.in_sine * w.re - t.in_cosine * w.im);
            const double square = -t.order * t.order;
            sum[0] += f;
            sum[1] += slope;
            sum[2] += square * f;
            sum[3] += square * slope;
            sum[4] += (square * square) * f;
        }
        return over_factorials(sum);
    }

    static std::array<Real, 5> over_factorials(const std::array<Real, 5>& x) {
        return {x[0], x[1], (1.0 / 2.0) * x[2], (1.0 / 6.0) * x[3], (1.0 / 24.0) * x[4]};
    }

    // The integral over theta, without the constant of integration.
    Real integral(const Powers::Values<Real>& z) const {
        Real sum{};
        for (const Term& t : terms_) sum += (t.in_cosine * z[t.place].im - t.in_sine * z[t.place].re) / t.order;
        return sum;
    }

private:
    template <class>
    friend class Series;

    struct Term {
        std::size_t place;
        double order;
        Real in_sine, in_cosine;
    };
    std::vector<Term> terms_;
};

}  // namespace cogless
