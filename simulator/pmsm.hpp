// Permanent-magnet synchronous motor in the rotor's frame, with saliency and flux harmonics (Liu 2018, eqs. (1) to (4)).
//
// The harmonics of both axes and the torque follow from one flux linkage, so that electrical power is copper loss, stored
// energy and torque times speed, to rounding.
#pragma once

#include <vector>

#include "harmonics.hpp"

namespace cogless {

// psi_d += d cos(order theta_e + d_phase), psi_q += q sin(order theta_e + q_phase); order of the electrical revolution
struct FluxHarmonic {
    int order;
    double d, q;              // V s
    double d_phase, q_phase;  // rad
};

struct PmsmConfig {
    int pole_pairs;
    double R_s;       // ohm
    double L_d, L_q;  // H
    double psi_f;     // V s, peak per phase of the star equivalent
    std::vector<FluxHarmonic> flux_harmonics;
    std::vector<Harmonic> cogging;  // N m, mechanical orders
};

struct Currents {
    double d, q;
};

class Pmsm {
public:
    Pmsm(const PmsmConfig& config, const Powers& powers)
        : config_(config), electrical_(powers.place(config.pole_pairs)), cogging_(powers, config.cogging) {
        std::vector<Harmonic> d, q;
        for (const FluxHarmonic& h : config.flux_harmonics) {
            d.push_back({h.order * config.pole_pairs, h.d, h.d_phase + quarter_turn});  // a cosine
            q.push_back({h.order * config.pole_pairs, h.q, h.q_phase});
        }
        psi_d_ = Series(powers, d);
        psi_q_ = Series(powers, q);
        has_flux_harmonics_ = !d.empty();
    }

    // The mechanical orders that this motor needs of Powers.
    static std::vector<int> orders(const PmsmConfig& config) {
        std::vector<int> all{config.pole_pairs};
        for (const FluxHarmonic& h : config.flux_harmonics) all.push_back(h.order * config.pole_pairs);
        for (const Harmonic& h : config.cogging) all.push_back(h.order);
        return all;
    }

    const PmsmConfig& config() const { return config_; }

    // Unit vector of the d axis in the stationary frame.
    Complex axis(const Powers::Values& z) const { return z[electrical_]; }

    double cogging(const Powers::Values& z) const { return cogging_.value(z); }

    // Work that cogging has stored, J.
    double cogging_energy(const Powers::Values& z) const { return -cogging_.integral(z); }

    double magnetic_energy(Currents i) const {
        return 0.75 * (config_.L_d * i.d * i.d + config_.L_q * i.q * i.q);
    }

    // Speed voltages per electrical speed, V s: the torque's linkages too.
    struct Linkage {
        double d, q;
    };

    Linkage linkage(const Powers::Values& z, Currents i) const {
        Linkage e{-config_.L_q * i.q, config_.psi_f + config_.L_d * i.d};
        if (has_flux_harmonics_) {
            const double per_pole_pair = 1.0 / config_.pole_pairs;  // slope() is per mechanical radian
            e.d += per_pole_pair * psi_d_.slope(z) - psi_q_.value(z);
            e.q += per_pole_pair * psi_q_.slope(z) + psi_d_.value(z);
        }
        return e;
    }

    double torque(Linkage e, Currents i) const { return 1.5 * config_.pole_pairs * (e.d * i.d + e.q * i.q); }

    Currents derivative(Linkage e, Currents i, double u_d, double u_q, double omega_m) const {
        const double omega_e = config_.pole_pairs * omega_m;
        return {(u_d - config_.R_s * i.d - omega_e * e.d) / config_.L_d,
                (u_q - config_.R_s * i.q - omega_e * e.q) / config_.L_q};
    }

private:
    static constexpr double quarter_turn = 1.5707963267948966;

    PmsmConfig config_;
    std::size_t electrical_;
    Series psi_d_, psi_q_, cogging_;
    bool has_flux_harmonics_ = false;
};

}  // namespace cogless
