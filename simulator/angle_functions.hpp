// What depends on the rotor's angle alone: the direction of the d axis, the flux harmonics, cogging, and the load's harmonics.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "harmonics.hpp"
#include "load.hpp"
#include "pmsm.hpp"
#include "wide.hpp"

namespace cogless {

// The functions' values at one angle.
template <class Real>
struct AtAngle {
    Complex<Real> axis;    // unit vector of the d axis in the stationary frame
    Linkage<Real> ripple;  // speed voltages per electrical speed due to flux harmonics, V s
    Real cogging, load;    // N m
};

template <class Real>
class AngleFunctions {
public:
    AngleFunctions(const PmsmConfig& motor, const LoadConfig& load)
        : powers_(orders(motor, load)), axis_(powers_.place(motor.pole_pairs)), axis_order_(motor.pole_pairs) {
        for (const FluxHarmonic& h : motor.flux_harmonics) {
            // e_d += d psi_d / d theta_e - psi_q and e_q += d psi_q / d theta_e + psi_d, written as sine and cosine
            const double order = static_cast<double>(h.order) / motor.pole_pairs;
            const double in_d = -order * h.d, in_q = order * h.q;
            const Complex<double> d = unit_vector(h.d_phase), q = unit_vector(h.q_phase);
            ripple_d_.add(powers_, h.order, in_d * d.re - h.q * q.re, in_d * d.im - h.q * q.im);
            ripple_q_.add(powers_, h.order, -in_q * q.im - h.d * d.im, in_q * q.re + h.d * d.re);
        }
        for (const Harmonic& h : motor.cogging) cogging_.add(powers_, h);
        for (const Harmonic& h : load.harmonics) load_.add(powers_, h);
    }

    // The functions of several motors whose harmonics have the same orders, one motor for each lane.
    explicit AngleFunctions(const Each<AngleFunctions<double>, Real>& of)
        requires is_wide<Real>
        : powers_(of[0]->powers_), axis_(of[0]->axis_), axis_order_(of[0]->axis_order_),
          ripple_d_(members(of, &AngleFunctions<double>::ripple_d_)),
          ripple_q_(members(of, &AngleFunctions<double>::ripple_q_)),
          cogging_(members(of, &AngleFunctions<double>::cogging_)), load_(members(of, &AngleFunctions<double>::load_)) {}

    // Whether this and `other` can be lanes of one object.
    bool alike(const AngleFunctions& other) const {
        return powers_ == other.powers_ && axis_ == other.axis_ && ripple_d_.alike(other.ripple_d_) &&
               ripple_q_.alike(other.ripple_q_) && cogging_.alike(other.cogging_) && load_.alike(other.load_);
    }

    // Sets ripple and cogging to those of the motor `of` with its magnets' flux times `flux`. Cogging is proportional to the
    // square of the flux.
    void scale(const AngleFunctions& of, double flux) {
        ripple_d_.scale(of.ripple_d_, flux);
        ripple_q_.scale(of.ripple_q_, flux);
        cogging_.scale(of.cogging_, flux * flux);
    }

    // Whether there are flux harmonics, cogging or harmonics of the load.
    bool ripples() const { return !(ripple_d_.empty() && cogging_.empty() && load_.empty()); }

    int highest_order() const { return powers_.highest_order(); }

    [[gnu::always_inline]] AtAngle<Real> at(Real theta_m) const {
        Powers::Values<Real> z;
        powers_.evaluate(theta_m, z);
        return {z[axis_], {ripple_d_.value(z), ripple_q_.value(z)}, cogging_.value(z), load_.value(z)};
    }

    // Calls put(k, coefficients) for the numbers of AtAngle in their order, k = 0 to 5. A number's coefficients are its first five
    // Taylor coefficients about theta_m.
    template <class Put>
    [[gnu::always_inline]] void taylor_at(Real theta_m, const Put& put) const {
        Powers::Values<Real> z;
        powers_.evaluate(theta_m, z);
        const double order = axis_order_, square = -order * order;
        const Complex<Real> axis = z[axis_];
        put(0, Series<Real>::over_factorials({axis.re, -order * axis.im, square * axis.re, -order * square * axis.im,
                                              square * square * axis.re}));
        put(1, Series<Real>::over_factorials({axis.im, order * axis.re, square * axis.im, order * square * axis.re,
                                              square * square * axis.im}));
        put(2, ripple_d_.taylor(z));
        put(3, ripple_q_.taylor(z));
        put(4, cogging_.taylor(z));
        put(5, load_.taylor(z));
    }

    // Energy stored in cogging, J.
    Real cogging_energy(Real theta_m) const {
        Powers::Values<Real> z;
        powers_.evaluate(theta_m, z);
        return -cogging_.integral(z);
    }

private:
    template <class>
    friend class AngleFunctions;

    static std::vector<int> orders(const PmsmConfig& motor, const LoadConfig& load) {
        std::vector<int> all{motor.pole_pairs};
        for (const FluxHarmonic& h : motor.flux_harmonics) all.push_back(h.order);
        for (const Harmonic& h : motor.cogging) all.push_back(h.order);
        for (const Harmonic& h : load.harmonics) all.push_back(h.order);
        return all;
    }

    Powers powers_;
    std::size_t axis_;
    double axis_order_;
    Series<Real> ripple_d_, ripple_q_, cogging_, load_;
};

}  // namespace cogless
