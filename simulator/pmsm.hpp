// Permanent-magnet synchronous motor in the rotor's frame, with saliency and flux harmonics (Liu 2018, eqs. (1) to (4)).
// With two phases instead of three it is the permanent-magnet step motor (Verrelli 2016, Section 5).
//
// The harmonics of both axes and the torque follow from one flux linkage. So the electrical power is the sum of copper loss, rate
// of the stored energy, and torque times speed, to rounding.
#pragma once

#include <memory>
#include <optional>
#include <type_traits>
#include <vector>

#include "harmonics.hpp"
#include "saturation.hpp"
#include "thermal.hpp"

namespace cogless {

// psi_d += d cos(order theta_m + d_phase), psi_q += q sin(order theta_m + q_phase); order: waves per mechanical revolution
struct FluxHarmonic {
    int order;
    double d, q;              // V s
    double d_phase, q_phase;  // rad
};

struct PmsmConfig {
    int pole_pairs;   // of a step motor: rotor teeth
    double R_s;       // ohm
    double L_d, L_q;  // H
    double psi_f;     // V s, peak per phase of the star equivalent
    std::vector<FluxHarmonic> flux_harmonics;
    std::vector<Harmonic> cogging;  // N m, mechanical orders
    int phases = 3;                 // 3 or 2
    std::optional<ThermalConfig> thermal = {};
    std::shared_ptr<const Saturation> saturation = {};  // replaces L_d and L_q, if given
};

template <class Real = double>
struct Currents {
    Real d, q;
};

// Speed voltages per electrical speed, V s; the torque uses the same linkages.
template <class Real = double>
struct Linkage {
    Real d, q;
};

template <class Real = double>
class Pmsm {
public:
    explicit Pmsm(const PmsmConfig& config)
        : power_factor_(0.5 * config.phases), pole_pairs_(config.pole_pairs), R_s_(config.R_s), L_d_(config.L_d),
          L_q_(config.L_q), psi_f_(config.psi_f), per_L_d_(1.0 / config.L_d), per_L_q_(1.0 / config.L_q),
          saturation_(config.saturation) {}

    // Several motors that are alike, one for each lane.
    explicit Pmsm(const Each<Pmsm<double>, Real>& of)
        requires is_wide<Real>
        : power_factor_(of[0]->power_factor_), pole_pairs_(of[0]->pole_pairs_), R_s_(each<Real>(of, &Pmsm<double>::R_s_)),
          L_d_(each<Real>(of, &Pmsm<double>::L_d_)), L_q_(each<Real>(of, &Pmsm<double>::L_q_)),
          psi_f_(each<Real>(of, &Pmsm<double>::psi_f_)), per_L_d_(each<Real>(of, &Pmsm<double>::per_L_d_)),
          per_L_q_(each<Real>(of, &Pmsm<double>::per_L_q_)) {}

    // Whether this and `other` can be lanes of one object.
    bool alike(const Pmsm& other) const {
        return power_factor_ == other.power_factor_ && pole_pairs_ == other.pole_pairs_ && !saturation_ &&
               !other.saturation_;
    }

    // Takes resistance and magnets' flux from the cold motor `of`, multiplied by these factors.
    void warm(const Pmsm& of, const Warmth& by) {
        R_s_ = of.R_s_ * by.resistance;
        psi_f_ = of.psi_f_ * by.flux;
    }

    double pole_pairs() const { return pole_pairs_; }

    // Ratio of the power of all phases to u_d i_d + u_q i_q in the amplitude-invariant frame: 3/2, or 1 with two phases.
    double power_factor() const { return power_factor_; }

    Real magnetic_energy(Currents<Real> i) const {
        if constexpr (std::is_same_v<Real, double>) {
            if (saturation_) return power_factor_ * saturation_->energy(i.d, i.q);
        }
        return 0.5 * power_factor_ * (L_d_ * i.d * i.d + L_q_ * i.q * i.q);
    }

    Real copper_loss(Currents<Real> i) const { return power_factor_ * R_s_ * (i.d * i.d + i.q * i.q); }

    bool saturates() const { return saturation_ != nullptr; }

    // ripple: the part due to flux harmonics. saturated, here and in derivative(): for a motor that saturates.
    template <bool saturated = false>
    [[gnu::always_inline]] Linkage<Real> linkage(Linkage<Real> ripple, Currents<Real> i) const {
        if constexpr (saturated) {
            const Saturation::Flux flux = saturation_->flux(i.d, i.q);
            return {ripple.d - flux.q, ripple.q + (psi_f_ + flux.d)};
        }
        return {ripple.d - L_q_ * i.q, ripple.q + (psi_f_ + L_d_ * i.d)};
    }

    [[gnu::always_inline]] Real torque(Linkage<Real> e, Currents<Real> i) const {
        return (power_factor_ * pole_pairs_) * (e.d * i.d + e.q * i.q);
    }

    template <bool saturated = false>
    [[gnu::always_inline]] Currents<Real> derivative(Linkage<Real> e, Currents<Real> i, Real u_d, Real u_q,
                                                     Real omega_m) const {
        const Real omega_e = pole_pairs_ * omega_m;
        if constexpr (saturated) {
            const Saturation::Flux l = saturation_->flux(i.d, i.q);
            const Real v_d = u_d - R_s_ * i.d - omega_e * e.d, v_q = u_q - R_s_ * i.q - omega_e * e.q;
            const Real per_det = 1.0 / (l.l_dd * l.l_qq - l.l_dq * l.l_dq);
            return {(l.l_qq * v_d - l.l_dq * v_q) * per_det, (l.l_dd * v_q - l.l_dq * v_d) * per_det};
        }
        return {(u_d - R_s_ * i.d) * per_L_d_ - (omega_e * per_L_d_) * e.d,
                (u_q - R_s_ * i.q) * per_L_q_ - (omega_e * per_L_q_) * e.q};
    }

private:
    template <class>
    friend class Pmsm;

    double power_factor_, pole_pairs_;
    Real R_s_, L_d_, L_q_, psi_f_;
    Real per_L_d_, per_L_q_;  // products cost less than quotients
    std::shared_ptr<const Saturation> saturation_ = {};
};

}  // namespace cogless
