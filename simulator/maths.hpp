// Elementary functions that give the same bits on every machine: those of C libraries differ in the last bit. The templates take
// one number or several at once (wide.hpp), so they have no branches.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace cogless {

template <class Real>
struct Complex {
    Real re, im;
};

template <class Real>
[[gnu::always_inline]] inline Complex<Real> operator*(Complex<Real> a, Complex<Real> b) {
    return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

// The nearest integer; |x| is below 2^51. The sum x + shift has no bits left for a fraction, so it is rounded.
template <class Real>
[[gnu::always_inline]] inline Real nearest(Real x) {
    constexpr double shift = 0x1.8p52;
    return (x + shift) - shift;
}

// The greatest integer that is not above x. A C library's floor is a call where the processor may lack the instruction.
inline double round_down(double x) {
    if (!(std::abs(x) < 0x1p52)) return x;
    const auto whole = static_cast<double>(static_cast<std::int64_t>(x));
    return whole > x ? whole - 1.0 : whole;
}

// e^{j x} within 2e-15 up to 4e8 rad; further out as exact as x itself.
//
// The angle is reduced to one revolution. The power series takes a quarter of it; two squarings give the whole.
template <class Real>
[[gnu::always_inline]] inline Complex<Real> unit_vector(Real x) {
    // 2 pi in three parts, of which the first two have 25 bits: their products with a number of turns below 2^28 are exact
    constexpr double turn_1 = 0x1.921fb5p+2, turn_2 = 0x1.110b46p-24, turn_3 = 0x1.1a62633145c07p-52;
    constexpr double per_turn = 0x1.45f306dc9c883p-3;
    const Real turns = nearest(x * per_turn);
    const Real r = 0.25 * (((x - turns * turn_1) - turns * turn_2) - turns * turn_3);
    const Real a = r * r, b = a * a, c = b * b;
    const Real even = ((1.0 - a * (1.0 / 2.0)) + b * (1.0 / 24.0 - a * (1.0 / 720.0))) +
                      c * ((1.0 / 40320.0 - a * (1.0 / 3628800.0)) + b * ((1.0 / 479001600.0 - a * (1.0 / 87178291200.0)) + b * (1.0 / 20922789888000.0)));
    const Real odd = ((1.0 - a * (1.0 / 6.0)) + b * (1.0 / 120.0 - a * (1.0 / 5040.0))) +
                     c * ((1.0 / 362880.0 - a * (1.0 / 39916800.0)) +
                          b * (1.0 / 6227020800.0 - a * (1.0 / 1307674368000.0)));
    const Complex<Real> quarter{even, r * odd}, half = quarter * quarter;
    return half * half;
}

inline double sine(double x) { return unit_vector(x).im; }
inline double cosine(double x) { return unit_vector(x).re; }

// e^x; x is at most 700.
inline double exponential(double x) {
    if (!(x > -745.0)) return x < 0.0 ? 0.0 : x;
    constexpr double ln2_1 = 0x1.62e42fefp-1, ln2_2 = 0x1.473de6af278edp-34;
    const double twos = nearest(x * 0x1.71547652b82fep+0), r = (x - twos * ln2_1) - twos * ln2_2;
    double sum = 1.0;
    for (int n = 14; n > 0; --n) sum = 1.0 + sum * r / n;
    return std::ldexp(sum, static_cast<int>(twos));
}

// The natural logarithm of a normal number above 0.
inline double logarithm(double x) {
    int twos;
    double m = std::frexp(x, &twos);  // in [1/2, 1)
    if (m < 0x1.6a09e667f3bcdp-1) {
        m *= 2.0;
        --twos;
    }
    // 2 artanh, whose argument is at most 0.172
    const double s = (m - 1.0) / (m + 1.0), a = s * s;
    double sum = 0.0;
    for (int n = 21; n > 1; n -= 2) sum = (sum + 1.0 / n) * a;
    constexpr double ln2_1 = 0x1.62e42fefp-1, ln2_2 = 0x1.473de6af278edp-34;
    return twos * ln2_1 + (2.0 * s + (2.0 * s * sum + twos * ln2_2));
}

// Bessel's functions of the first kind J_0(x) ... J_{count-1}(x), x >= 0, by Miller's backward recurrence.
inline std::vector<double> bessel_j(std::size_t count, double x) {
    std::vector<double> all(count, 0.0);
    if (x == 0.0) {
        if (count > 0) all[0] = 1.0;
        return all;
    }
    // beyond this order the functions are below the smallest number that matters here
    auto n = static_cast<std::size_t>(std::fmax(static_cast<double>(count), x + 30.0 + 10.0 * std::sqrt(x)));
    double above = 0.0, here = std::numeric_limits<double>::min() * 0x1p60, sum = 0.0;
    for (n += n % 2; n > 0; --n) {
        const double below = 2.0 * static_cast<double>(n) / x * here - above;
        above = here;
        here = below;
        if (std::abs(here) > 0x1p500) {  // the scale is free until the end
            here *= 0x1p-600;
            above *= 0x1p-600;
            sum *= 0x1p-600;
            for (double& value : all) value *= 0x1p-600;
        }
        if (n - 1 < count) all[n - 1] = here;
        if ((n - 1) % 2 == 0) sum += n == 1 ? here : 2.0 * here;  // 1 = J_0 + 2 J_2 + 2 J_4 + ...
    }
    for (double& value : all) value /= sum;
    return all;
}

}  // namespace cogless
