// Permanent-magnet synchronous motor in the rotor's frame, with saliency and flux harmonics (Liu 2018, eqs. (1) to (4)).
// With two phases instead of three it is the permanent-magnet step motor (Verrelli 2016, Section 5).
//
// The harmonics of both axes and the torque follow from one flux linkage, so that electrical power is copper loss, stored
// energy and torque times speed, to rounding.
#pragma once

#include <vector>

#include "harmonics.hpp"

namespace cogless {

// psi_d += d cos(order theta_e + d_phase), psi_q += q sin(order theta_e + q_phase); order: waves per electrical revolution
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
    int phases = 3;                 // or 2
};

struct Currents {
    double d, q;
};

class Pmsm {
public:
    Pmsm(const PmsmConfig& config, const Powers& powers)
        : config_(config), power_factor_(0.5 * config.phases), torque_factor_(power_factor_ * config.pole_pairs),
          per_L_d_(1.0 / config.L_d), per_L_q_(1.0 / config.L_q),
          electrical_(powers.place(config.pole_pairs)), cogging_(powers, config.cogging) {
        for (const FluxHarmonic& h : config.flux_harmonics) {
            // e_d += d psi_d / d theta_e - psi_q and e_q += d psi_q / d theta_e + psi_d, written as sine and cosine
            const double in_d = -h.order * h.d, in_q = h.order * h.q;
            const Complex d{std::cos(h.d_phase), std::sin(h.d_phase)}, q{std::cos(h.q_phase), std::sin(h.q_phase)};
            flux_.push_back({powers.place(h.order * config.pole_pairs),
                             in_d * d.re - h.q * q.re, in_d * d.im - h.q * q.im,
                             -in_q * q.im - h.d * d.im, in_q * q.re + h.d * d.re});
        }
    }

    // The mechanical orders that Powers must provide for this motor.
    static std::vector<int> orders(const PmsmConfig& config) {
        std::vector<int> all{config.pole_pairs};
        for (const FluxHarmonic& h : config.flux_harmonics) all.push_back(h.order * config.pole_pairs);
        for (const Harmonic& h : config.cogging) all.push_back(h.order);
        return all;
    }

    const PmsmConfig& config() const { return config_; }

    // Ratio of the power of all phases to u_d i_d + u_q i_q in the amplitude-invariant frame: 3/2, or 1 with two phases.
    double power_factor() const { return power_factor_; }

    // Unit vector of the d axis in the stationary frame.
    Complex axis(const Powers::Values& z) const { return z[electrical_]; }

    double cogging(const Powers::Values& z) const { return cogging_.value(z); }

    // Energy stored in cogging, J.
    double cogging_energy(const Powers::Values& z) const { return -cogging_.integral(z); }

    double magnetic_energy(Currents i) const {
        return 0.5 * power_factor_ * (config_.L_d * i.d * i.d + config_.L_q * i.q * i.q);
    }

    // Speed voltages per electrical speed, V s; the torque uses the same linkages.
    struct Linkage {
        double d, q;
    };

    Linkage linkage(const Powers::Values& z, Currents i) const {
        Linkage e{-config_.L_q * i.q, config_.psi_f + config_.L_d * i.d};
        for (const FluxTerm& t : flux_) {
            const Complex w = z[t.place];
            e.d += t.d_sine * w.im + t.d_cosine * w.re;
            e.q += t.q_sine * w.im + t.q_cosine * w.re;
        }
        return e;
    }

    double torque(Linkage e, Currents i) const { return torque_factor_ * (e.d * i.d + e.q * i.q); }

    Currents derivative(Linkage e, Currents i, double u_d, double u_q, double omega_m) const {
        const double omega_e = config_.pole_pairs * omega_m;
        return {(u_d - config_.R_s * i.d - omega_e * e.d) * per_L_d_,
                (u_q - config_.R_s * i.q - omega_e * e.q) * per_L_q_};
    }

private:
    // A flux harmonic's contribution to the speed voltages, V s.
    struct FluxTerm {
        std::size_t place;
        double d_sine, d_cosine, q_sine, q_cosine;
    };

    PmsmConfig config_;
    double power_factor_, torque_factor_;
    double per_L_d_, per_L_q_;  // products cost less than quotients
    std::size_t electrical_;
    std::vector<FluxTerm> flux_;
    Series cogging_;
};

}  // namespace cogless
